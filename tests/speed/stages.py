"""Item 9: where the time goes at 1024 lanes, against what the machine can do."""

from __future__ import annotations

import time

import numpy as np
from numba import njit

from magwire_env.simulation.lanes import LANES, gather, load, row, spread, store
from magwire_env.simulation.locked import algorithm1 as a1
from magwire_env.simulation.magnetics import Magnetics
from magwire_env.simulation.rig_arrays import aligned_zeros
from tests.speed.measure import table
from tests.speed.rates import TASK, max_force_actions

_JIT = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}


@njit(**_JIT)
def _multiply_adds(a, n):
    """n × 12 independent multiply-adds of a block, from registers."""
    x0, x1, x2, x3 = load(a, 0), load(a, 1), load(a, 2), load(a, 3)
    y0, y1, y2, y3, y4, y5 = x0, x1, x2, x3, x0, x1
    for _ in range(n):
        y0, y1, y2 = y0 * x0 + x1, y1 * x0 + x1, y2 * x0 + x1
        y3, y4, y5 = y3 * x0 + x1, y4 * x0 + x1, y5 * x0 + x1
        y0, y1, y2 = y0 * x2 + x3, y1 * x2 + x3, y2 * x2 + x3
        y3, y4, y5 = y3 * x2 + x3, y4 * x2 + x3, y5 * x2 + x3
    store(a, 0, y0 + y1 + y2 + y3 + y4 + y5)


@njit(**_JIT)
def _loads(a, n, rows):
    """n × rows loads of a block from the innermost cache, summed."""
    x0, x1 = spread(0.0), spread(0.0)
    for _ in range(n):
        for i in range(0, rows, 2):
            x0, x1 = x0 + load(a, i * LANES), x1 + load(a, (i + 1) * LANES)
    store(a, 0, x0 + x1)


@njit(**_JIT)
def _gathers(a, n):
    """n × 12 gathers of a block, as many as one joint needs of the tract's table, rows 12 numbers apart."""
    x0, x1 = spread(0.0), spread(0.0)
    for k in range(n):
        rows = load(a, (k % 4) * LANES)
        for j in range(0, 12, 2):
            x0, x1 = x0 + gather(a, rows, 4 * LANES + j), x1 + gather(a, rows, 4 * LANES + j + 1)
    store(a, 4 * LANES, x0 + x1)


@njit(**_JIT)
def _magnets(wires, rig, q, out):
    wires, rig = a1.Wires(*wires), Magnetics(*rig)
    for b in range(len(wires.par)):
        par, s = row(wires.par, b), row(wires.s, b)
        a1.tip_pose(load(s, wires.s.shape[1] - 1), par, wires.table, out)
        a1.magnetic_force(b, par, rig, q, out)


@njit(**_JIT)
def _forces(wires, out, w, speeds, h, how):
    """how : 0 poses alone, 1 with the forces, 2 with the solve."""
    wires = a1.Wires(*wires)
    nodes = wires.s.shape[1]
    for b in range(len(wires.par)):
        par, s = row(wires.par, b), row(wires.s, b)
        for i in range(nodes):
            store(speeds, i, load(wires.v, b, i))
        a1.friction_of_speed(w, nodes, par, speeds)
        a1.tip_pose(load(s, nodes - 1), par, wires.table, out)
        if how > 0:
            a1.joint_forces(w, nodes, 0, row(wires.wire, b), par, wires.table, out, s, speeds, h)
        if how > 1:
            a1.integrate(w, nodes, par, speeds)


def _best(run, repeats: int = 60) -> float:
    """Shortest of several runs, s."""
    run()
    found = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        found.append(time.perf_counter() - start)
    return min(found)


def ceiling() -> tuple[float, float, float]:
    """This core's double-precision FLOPs/s, bytes loaded/s from the first cache, and numbers gathered/s, measured."""
    a, n = aligned_zeros(4096), 20000
    flops = n * 12 * LANES * 2 / _best(lambda: _multiply_adds(a, n))
    loaded = n * 64 * LANES * 8 / _best(lambda: _loads(a, n, 64))
    a[: 4 * LANES] = 12.0 * np.random.default_rng(0).integers(0, 300, 4 * LANES)
    return flops, loaded, n * 12 * LANES / _best(lambda: _gathers(a, n))


def running_batch(steps: int = 40):
    """A batch under the paper's policy, as it stands after some steps."""
    import gymnasium as gym

    actions = max_force_actions({}, 1024, steps)
    envs = gym.make_vec(TASK, num_envs=1024, threads=1)
    envs.reset(seed=0)
    for action in actions:
        envs.step(action)
    return envs.unwrapped.core, actions[-1]


def stage_times() -> tuple[dict[str, float], int]:
    """Seconds a control step of 1024 lanes by stage, on one thread; and the lane-node-substeps in it.

    Every stage is repeated on its own on the same state; the solve and the rest are differences.
    """
    core, action = running_batch()
    sim, library = core.sim, core.sim.library
    model, rig, substeps = sim.model, sim.rig, library.substeps
    wires, h = model._wires, library.control_period / substeps
    w, out, q, _ = (array.copy() for array in model._works[0])
    q[...] = np.pi
    speeds = aligned_zeros(model.nodes, LANES)
    moving = model._s, model._v, rig.q
    before = [array.copy() for array in moving]

    def restored() -> None:
        for array, was in zip(moving, before, strict=True):
            array[...] = was

    def period() -> None:
        restored()
        model.step()

    magnet = _best(lambda: _magnets(wires, rig.magnetics, q, out))
    poses = _best(lambda: _forces(wires, out, w, speeds, h, 0))
    forces = _best(lambda: _forces(wires, out, w, speeds, h, 1))
    solved = _best(lambda: _forces(wires, out, w, speeds, h, 2))
    whole = _best(period, 60) - _best(restored)
    model.step = lambda: None
    envs = _best(lambda: core.step(action)) + _best(core.observe)
    del model.step
    stages = {
        "i, the magnet's force (once more at the end)": (substeps + 1) * magnet,
        "ix, iv, v, vii and the first elimination": substeps * (forces - poses),
        "vi, back substitution, friction, further Newton steps": substeps * (solved - forces),
    }
    stages["viii, servo, traces, results"] = whole - sum(stages.values())
    stages["command, reward, observation, info"] = envs
    return stages, 1024 * model.nodes * substeps


def where_the_time_goes() -> str:
    """Item 9."""
    stages, count = stage_times()
    total = sum(stages.values())
    flops, loaded, gathered = ceiling()
    rows = [(name, f"{1e9 * s / count:.2f}", f"{s / total:.0%}") for name, s in stages.items()]
    rows.append(("all", f"{1e9 * total / count:.2f}", "100%"))
    text = table(("stage", "ns a lane, node and substep", "share"), rows)
    return f"""{text}

One core's ceiling, measured: {flops / 1e9:.0f} GFLOP/s in multiply-adds, {loaded / 1e9:.0f} GB/s loaded from the first
cache, {gathered / 1e9:.2f} G numbers/s gathered. A joint's pass needs 12 numbers of the tract's table and about
{FLOPS} FLOPs: {12e9 / gathered:.1f} ns of gathering, {1e9 * FLOPS / flops:.1f} ns of arithmetic."""


FLOPS = 240
"""A node and substep: snap 45, spring 85, bending 50, elimination 20, back substitution and friction 40; counted by
hand, a multiply-add as two, a square root or a division by its multiply-adds."""
