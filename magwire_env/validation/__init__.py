"""The list of physics checks: quantity, expected, source, ours. `magwire validate` prints it at full size.

One list, two sizes: `run(CHECKS, FULL)` for the record, `run(CHECKS, TEST)` in the test suite.
"""

from __future__ import annotations

from . import claims, inverse, magnets, motion, rods
from .report import FULL, TEST, Check, Row, Size, run, table

__all__ = ["CHECKS", "FULL", "TEST", "Check", "Row", "Size", "run", "table"]

CHECKS = (
    Check("printed constants", magnets.printed_constants),
    Check("block and tip, coaxial", magnets.coaxial),
    Check("block against magpylib", magnets.exact_block, needs="magpylib"),
    Check("simulator's tip force against magpylib", magnets.along_the_tract, needs="magpylib"),
    Check("conservation laws of dipoles", magnets.conservation),
    Check("cantilever", lambda size: rods.elastica_rows(size.segments)),
    Check("tip dipole in a uniform field", lambda size: rods.end_couple_rows(size.segments)),
    Check("buckling", lambda size: rods.buckling(size.segments // 5)),
    Check("order of the free rod", lambda size: rods.order_in_segments(size.segments)),
    Check("springs in series", lambda size: rods.series_springs(size.segments)),
    Check("snap of the free rod", lambda _: rods.axial_snap(12)),
    Check("cantilever against PyElastica", lambda size: rods.cosserat(size.segments), needs="elastica"),
    Check("random loads on the free rod", rods.random_loads),
    Check("from shapes back to fields", inverse.inverse),
    Check("friction on a straight tract", motion.friction),
    Check("capstan", motion.capstan),
    Check("release force", motion.release_force),
    Check("creep out of a bend", motion.creep_out),
    Check("generalised force", motion.generalised_force),
    Check("closed tract", motion.closed_tract),
    Check("energy", motion.energy),
    Check("convergence in step and mesh", motion.convergence),
    Check("the paper's claim", claims.claim),
    Check("its limits", claims.limits),
    Check("the coupling", claims.coupling),
)
