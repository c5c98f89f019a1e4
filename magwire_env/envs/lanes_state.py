"""The state of a batch between two steps as plain values, so that a training can go on as if it had never stopped.

An episode's draws (scenario, start, goal or reference, variation, reading errors) are not stored: they follow again
from the lane's generator as it was when the episode began. What has moved since is stored.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from ..simulation import Places
from ..words import counted

if TYPE_CHECKING:
    from .vector_env import MagWireVectorEnv

__all__ = ["lanes_state", "load_lanes"]


def lanes_state(env: MagWireVectorEnv) -> dict[str, Any]:
    """Everything that the batch's future depends on, as dicts, lists, numbers and arrays.

    Episodes that were begun with options are not served, since their draws do not follow from the generators.
    """
    core = env.core
    wires, goals = core.sim.state(), core.sim.goals()
    return {
        "generators": [_state_of(rng) for rng in env.generators],
        "began": list(env.began),
        "ended": env._ended.copy(),
        "started": env._started,
        "wires": {"wire": wires.wire, "magnet": wires.magnet, "time": wires.time},
        "goals": {"s": goals.s, "branch": goals.branch},
        "episodes": core.episodes.lanes[:, : env.num_envs].copy(),
        "turned": core.episodes.turned.copy(),
        "action": core.action.copy(),
        "readings": core.shown.readings.history(),
        "navigation": core.navigation.state() if core.navigation else {},
    }


def load_lanes(env: MagWireVectorEnv, state: dict[str, Any]) -> None:
    """Put a batch of the same settings where `lanes_state` found another.

    Raises `ValueError` for a state that does not fit the batch.
    """
    core, n = env.core, env.num_envs
    if len(state["generators"]) != n or len(state["began"]) != n:
        raise ValueError(f"state must be of {counted(n, 'lane')}, got {len(state['generators'])}")
    try:
        rngs = [_generator(before) for before in state["began"]]
        lanes = np.arange(n)
        core.begin(lanes, rngs, None)
        core.sim.set_goal(lanes, Places(**state["goals"]))
        core.sim.load_state(dataclasses.replace(core.sim.state(), **state["wires"]))
        if core.shapes:
            core.shapes.measure()
        core.episodes.lanes[:, :n] = state["episodes"]
        core.episodes.turned[:] = state["turned"]
        core.action[:] = state["action"]
        core.shown.readings.load_history(state["readings"])
        if core.navigation:
            core.navigation.load_state(state["navigation"])
        env._ended[:] = state["ended"]
        env._started = bool(state["started"])
        env.began[:] = state["began"]
        env.generators[:] = [_generator(now) for now in state["generators"]]
    except (KeyError, TypeError, IndexError) as error:
        raise ValueError(f"state must be of a batch like this one: {type(error).__name__}: {error}") from error


def _state_of(rng: np.random.Generator | None) -> dict[str, Any] | None:
    return None if rng is None else dict(rng.bit_generator.state)


def _generator(state: dict[str, Any]) -> np.random.Generator:
    """A generator of the kind that Gymnasium seeds, in a given state."""
    rng = np.random.Generator(np.random.PCG64())
    rng.bit_generator.state = state
    return rng
