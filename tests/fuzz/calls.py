"""Calls of the simulator and the envs with wrong lanes, states, numbers and shapes: refused by name, or right.

`python -m tests.fuzz.calls --count 100000 [--seed N]` prints counts, and ends with status 1 at the first call that
raises anything but `ValueError`, changes something before it raises, or leaves a number that is not finite. Best under
``NUMBA_BOUNDSCHECK=1``, which checks every index in the kernels.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from magwire_env import Scenario, Simulator
from magwire_env.simulation import Places

Call = Callable[[Simulator, np.random.Generator], None]

LANES = 21
WILD = [0.0, -1.0, 1e-300, 1e300, -1e300, np.inf, -np.inf, np.nan, 0.3, 7.0, 1e9]


def number(rng: np.random.Generator) -> float:
    """A number, half of the time a wild one."""
    return float(rng.choice(WILD)) if rng.random() < 0.3 else float(rng.uniform(-0.2, 0.9))


def lanes(rng: np.random.Generator) -> Any:
    """Lane numbers of the right or a wrong kind."""
    n = int(rng.integers(0, 6))
    right = rng.integers(0, LANES, n)
    return [
        right, right, right, right.astype(np.uint8), rng.integers(-3, LANES + 3, n), right.astype(float),
        [str(i) for i in right], np.int64(rng.integers(-2, LANES + 2)), right[None], [2**62], [True] * n, [], None,
        rng.integers(-(2**63), 2**63 - 1, n),
    ][rng.integers(14)]  # fmt: skip


def array(rng: np.random.Generator, *shape: int) -> Any:
    """Numbers of a shape that is most often the right one."""
    shape = tuple(max(0, s + int(rng.integers(-1, 2))) for s in shape) if rng.random() < 0.2 else shape
    values = np.array([number(rng) for _ in range(int(np.prod(shape)))]).reshape(shape)
    return values if rng.random() < 0.9 else [values.tolist(), "text", None, values.astype(object)][rng.integers(4)]


def count_of(chosen: Any) -> int:
    """How many lanes were meant."""
    return LANES if chosen is None else np.size(chosen)


def reset(sim: Simulator, rng: np.random.Generator) -> None:
    chosen = lanes(rng)
    n = count_of(chosen)
    magnet = array(rng, n, 1) if rng.random() < 0.5 else None
    sim.reset(array(rng, n) if rng.random() < 0.7 else number(rng), magnet, chosen)


def step(sim: Simulator, rng: np.random.Generator) -> None:
    sim.step(array(rng, LANES, 1))


def assign(sim: Simulator, rng: np.random.Generator) -> None:
    chosen = lanes(rng)
    sim.assign(chosen, rng.integers(-1, 3, np.size(chosen)))
    sim.reset(lanes=chosen)


def vary(sim: Simulator, rng: np.random.Generator) -> None:
    chosen = lanes(rng)
    n = np.size(chosen)
    sim.vary(chosen, array(rng, n), array(rng, n), array(rng, n), 1e-3 * np.zeros((n, 1, 3)))
    sim.assign(chosen, np.zeros(n, dtype=np.int64))
    sim.reset(lanes=chosen)


def goal(sim: Simulator, rng: np.random.Generator) -> None:
    chosen = lanes(rng)
    sim.set_goal(chosen, Places(np.full(count_of(chosen), rng.uniform(0, 0.8))))


def rig(sim: Simulator, rng: np.random.Generator) -> None:
    chosen = lanes(rng)
    sim.set_rig(array(rng, count_of(chosen), 1), chosen)


def state(sim: Simulator, rng: np.random.Generator) -> None:
    kept = sim.state(lanes(rng))
    kind = int(rng.integers(4))
    if kind == 1:
        kept = kept.replaced(arclengths=number(rng))
        if np.isfinite(kept.wire).all() and np.abs(kept.wire).max() > 10.0:
            return  # finite and absurd: it moves, and diverges
    elif kind == 2 and len(kept):
        kept = kept[rng.integers(0, len(kept), 3)]
    elif kind == 3:
        kept = kept.replaced(magnet=array(rng, len(kept), 1))
    sim.load_state(kept)


def rollout(sim: Simulator, rng: np.random.Generator) -> None:
    kept = sim.state(lanes(rng))
    sim.rollout(kept, array(rng, *rng.integers(0, 4, 2), 1))


def look(sim: Simulator, rng: np.random.Generator) -> None:
    sim.refresh(lanes(rng))
    assert np.isfinite(sim.ahead(np.array([rng.uniform(-1, 1)]))[0]).all()


CALLS: tuple[Call, ...] = (reset, step, step, assign, vary, goal, rig, state, rollout, look)


def fuzz(count: int, seed: int) -> Counter:
    """Make `count` calls; counts of those that were right and of those refused, by name."""
    rng, seen = np.random.default_rng(seed), Counter()
    scenarios = [Scenario.paper(), Scenario.paper().replace(name="other", contact__friction=0.2)]
    sim = Simulator(scenarios, LANES, lane_scenario=np.zeros(LANES, dtype=np.int64))
    for i in range(count):
        call = CALLS[rng.integers(len(CALLS))]
        where = f"call {i} of seed {seed}, {call.__name__}"
        before = sim.state()
        try:
            call(sim, rng)
            seen[f"{call.__name__} right"] += 1
        except ValueError as refusal:
            seen[f"{call.__name__} refused"] += 1
            if not str(refusal):
                raise AssertionError(f"{where}: refused without a word") from refusal
            if call not in (assign, vary) and sim.state() != before:
                raise AssertionError(f"{where}: changed, then refused") from refusal
        except Exception as error:
            raise AssertionError(f"{where}: {type(error).__name__}: {error}") from error
        now = sim.state()
        if not (np.isfinite(now.wire).all() and np.isfinite(sim.readout).all()):
            raise AssertionError(f"{where}: left numbers that are not finite")
        if np.abs(now.wire[:, : sim.model.nodes]).max() > 5.0:  # led astray: begin anew
            sim.assign(np.arange(LANES), np.zeros(LANES, dtype=np.int64))
            sim.reset()
    return seen


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print(dict(sorted(fuzz(options.count, options.seed).items())))


if __name__ == "__main__":
    main()
