"""The reward as one ordered table: from it come the weights' fields, the names in `info`, the documentation.

The formulas of the built-in terms stand in `kernels.judge`, in the table's order. Terms of your own are `RewardTerm`s.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..physics.checks import finite, non_negative

if TYPE_CHECKING:
    from .core import SteeringCore

__all__ = ["TERMS", "RewardTerm", "RewardWeights", "Term", "info_name"]


def _weight(default: float, text: str) -> Any:
    """A field of `RewardWeights`: a term's default weight, and what the term is."""
    return field(default=default, metadata={"text": text})


@dataclass(frozen=True)
class RewardWeights:
    """Weights of the reward's terms, every one echoed in `info` as ``reward/…``. Its fields are the table of terms."""

    success: float = _weight(10.0, "once, on reaching the goal")
    progress: float = _weight(
        10.0,
        "for the whole way from the start to the goal, paid as it is covered (potential-based); in a tracking task for "
        "each tolerance by which the distance shrinks",
    )
    time: float = _weight(
        0.1,
        "cost of each control step; in a tracking task of each step and tolerance of distance. An end without success "
        "before the time limit pays for the steps that were left too, so that giving up never pays",
    )
    wall: float = _weight(0.5, "cost of each control step for each newton of wall force above the scenario's limit")
    travel: float = _weight(0.0, "cost of each radian or metre that the rig moves, so that commands become smooth")

    def __post_init__(self) -> None:
        for one in fields(self):
            object.__setattr__(self, one.name, non_negative(f"RewardWeights.{one.name}", getattr(self, one.name)))


class Term(NamedTuple):
    """A built-in term: its name, its weight by default, and what it is."""

    name: str
    weight: float
    text: str


_DEFAULTS = RewardWeights()
TERMS = tuple(Term(one.name, getattr(_DEFAULTS, one.name), one.metadata["text"]) for one in fields(RewardWeights))
"""The terms in the order in which `kernels.judge` has them."""


def info_name(term: str) -> str:
    """Where `info` holds a term."""
    return f"reward/{term}"


class RewardTerm(NamedTuple):
    """A term of your own, for ``gym.make(…, reward_terms=[RewardTerm(…)])``; in the batch as in the single env.

    name : it stands in `info` as ``reward/<name>``
    weight : its value is the weight times what `of` gives; negative for a cost
    of : core → (n,), after each control period; `core.sim` is the simulator, `core.action` the action just taken

    >>> import gymnasium as gym, numpy as np, magwire_env
    >>> from magwire_env.envs.rewards import RewardTerm
    >>> gentle = RewardTerm("torque", -1e3, lambda core: core.sim.tip_torque)     # a cost of 1 for each mN·m
    >>> envs = gym.make_vec("MagWire/Steer-v0", num_envs=2, reward_terms=[gentle])
    >>> _ = envs.reset(seed=0)
    >>> reward, info = (x := envs.step(envs.action_space.sample()))[1], x[4]
    >>> bool((info["reward/torque"] < 0).all())
    True
    """

    name: str
    weight: float
    of: Callable[[SteeringCore], np.ndarray]


def checked_terms(terms: Any) -> tuple[RewardTerm, ...]:
    """`RewardTerm`s with names of their own. Raises `ValueError` naming the one that is not."""
    found: list[RewardTerm] = []
    for i, term in enumerate(terms):
        if not isinstance(term, RewardTerm) or not callable(term.of):
            raise ValueError(f"reward_terms[{i}] must be a RewardTerm, got {term!r}")
        if term.name in [*(one.name for one in TERMS), *(one.name for one in found)]:
            raise ValueError(f"reward_terms[{i}].name must differ from the other terms' names, got {term.name!r}")
        finite(f"reward_terms[{i}].weight", term.weight, "1")
        found.append(term)
    return tuple(found)
