"""Measurements by others that our models are held against; `magwire experiment NAME --data FILE` runs one.

The data are read from where the user has them; none are shipped.
"""

from . import continuum_robot, helices, loops, turning
from .report import Experiment, Outcome

__all__ = ["EXPERIMENTS", "Experiment", "Outcome"]

EXPERIMENTS: dict[str, Experiment] = {
    e.name: e
    for e in (
        Experiment(
            "helices",
            "clamped helices that buckle (E1)",
            "e1_helix_buckling.csv",
            "measurements of Tong, Borum, Jawed (arXiv 2112.09208; StructuresComp/Helix_Bifurcation_Types), with the "
            "columns c1, c2, kL_measured, jump (1 or 0) and kL_theory",
            helices.run,
        ),
        Experiment(
            "continuum_robot",
            "tip of a magnetic continuum robot in the open (E2)",
            "e2_mcr_tip_poses.csv",
            "tip poses of the video tracker in ethz-msrl/mCR_simulator (Dreyfus, Boehler, Nelson, RA-L 2022), with the "
            "columns run, t_s, x_m, y_m and angle_rad (from +y to +x)",
            continuum_robot.run,
            run_in=continuum_robot.run,
        ),
        Experiment(
            "loops",
            "hanging loops of three real wires (E3)",
            "e3_hanging_loops.csv",
            "mean shapes of the wires in qj25/adapteddlo_muj (MIT; arXiv 2310.00911), with the columns wire, s_over_L, "
            "x and y in mm, y down, from the near clamp",
            loops.run,
        ),
        Experiment("turning", "turning while pushing (E6)", "", turning.SOURCE, turning.run),
    )
}
"""By name."""
