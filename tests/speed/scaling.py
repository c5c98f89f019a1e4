"""Item 7 and the work–precision curve: cost against nodes, lanes, dipoles and resolution."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from magwire_env import Scenario, Simulator
from tests.speed.measure import number, table, timed
from tests.speed.rates import said, worst_accuracy

NODES = (8, 16, 32, 64, 128)
LANES = (1, 4, 16, 64, 256, 1024, 4096, 16384)
DIPOLES = (1, 8, 21, 64, 216, 512, 2000)


def with_dipoles(scenario: Scenario, rule: tuple) -> Scenario:
    """The scenario with its magnet as a cloud by this rule."""
    mounts = tuple(dataclasses.replace(m, dipoles=rule) for m in scenario.rig.magnets)
    return scenario.replace(rig=dataclasses.replace(scenario.rig, magnets=mounts))


def seconds_a_step(scenario: Scenario, lanes: int = 1024, threads: int | None = 1, repeats: int = 9) -> float:
    """Median time of one control period of a moving batch, s."""
    sim = Simulator(scenario, lanes, threads=threads)
    rng = np.random.default_rng(0)
    sim.reset(tip_arclength=rng.uniform(0.15, 0.6, lanes))
    commands = np.pi + 0.5 * np.sin(rng.uniform(0, 6, (lanes, 1)) + np.arange(repeats + 3)[:, None, None] / 3)
    return float(np.median([timed(lambda c=c: sim.step(c)) for c in commands][3:]))


def memory_a_lane(scenario: Scenario) -> float:
    """Bytes a lane of the simulator's arrays."""
    sim = Simulator(scenario, 1024, threads=1)
    owners = (sim, sim.rig, sim.model)
    arrays = {id(a): a for owner in owners for a in vars(owner).values() if isinstance(a, np.ndarray)}
    return sum(a.nbytes for a in arrays.values()) / 1024


def scaling(plot: Path | None) -> str:
    """Item 7: a table a size, fitted exponents, memory a lane, and the plot."""
    paper = Scenario.paper()
    rules = {n: ("fitted", n) if n == 21 else ("grid", (10, 10, 20)) if n == 2000 else ("gauss", round(n ** (1 / 3)))
             for n in DIPOLES}  # fmt: skip
    curves = {
        "nodes": (NODES, [seconds_a_step(paper.replace(wire__segments=n - 1)) for n in NODES]),
        "lanes": (LANES, [seconds_a_step(paper, n, None) for n in LANES]),
        "dipoles": (DIPOLES, [seconds_a_step(with_dipoles(paper, rules[n])) for n in DIPOLES]),
    }
    parts = []
    for name, (sizes, seconds) in curves.items():
        whole = np.polyfit(np.log(sizes), np.log(seconds), 1)[0]
        last = np.log(seconds[-1] / seconds[-2]) / np.log(sizes[-1] / sizes[-2])
        rows = [("µs a control step", *(f"{1e6 * s:.4g}" for s in seconds))]
        text = table((name, *map(str, sizes)), rows)
        parts.append(f"{text}\n\nExponent over the whole range {whole:.2f}, over the last two {last:.2f}.")
    parts.append(f"Memory: {memory_a_lane(paper) / 1024:.1f} KiB a lane at the default resolution.")
    if plot:
        drawn(curves, plot)
        parts.append(f"![Cost against nodes, lanes and dipoles]({plot.name})")
    return "\n\n".join(parts)


def drawn(curves: dict, path: Path) -> None:
    """The log–log plot, as PNG."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
    heads = {"nodes": "1024 lanes, one thread", "lanes": "default, all threads", "dipoles": "1024 lanes, one thread"}
    for axis, (name, (sizes, seconds)) in zip(axes, curves.items(), strict=True):
        sizes, micro = np.array(sizes), 1e6 * np.array(seconds)
        axis.loglog(sizes, micro, "o-", label="measured")
        axis.loglog(sizes, micro[-1] * sizes / sizes[-1], "k:", label="linear")
        axis.set(xlabel=name, ylabel="µs a control step", title=heads[name])
        axis.grid(alpha=0.3, which="both")
        axis.legend()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def work_precision(refs: list) -> str:
    """Cost and error over segments and substeps: why the default is what it is."""
    rows = []
    for segments in (8, 10, 12, 16, 20, 24, 30):
        for substeps in (1, 2, 3, 5):
            fine = Scenario.paper().replace(wire__segments=segments, timing__substeps=substeps)
            rows.append((seconds_a_step(fine), segments, substeps, said(worst_accuracy(segments, substeps, refs))))
    default = Scenario.paper()
    chosen = default.wire.segments, default.substeps
    head = ("segments", "substeps", "lane steps/s, one thread, kernel alone", "worst of five scenarios")
    return table(
        head,
        [
            (f"**{n}**" if (n, k) == chosen else n, f"**{k}**" if (n, k) == chosen else k, number(1024 / seconds), text)
            for seconds, n, k, text in sorted(rows)
        ],
    )
