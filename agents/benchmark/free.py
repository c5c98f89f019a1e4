"""The benchmark of free wires: its arenas and learners. They have no par, so times are given over a reference's."""

from __future__ import annotations

from ..catalogue import OF_TREES
from .plan import Arena, Learner

__all__ = ["FREE_ARENAS", "FREE_LEARNERS"]

_IN_TREES = (*OF_TREES, "Random", "untrained")
_STILL = ("HoldHome", "ConstantRotation", "Random", "untrained")


def _tree(name: str, task: str, reference: str = "FollowRoute", episodes: int = 100, **settings: str) -> Arena:
    return Arena(name, task, episodes=episodes, controllers=_IN_TREES, reference=reference, **settings)


FREE_ARENAS: tuple[Arena, ...] = (
    _tree("Navigate", "MagWire/Navigate-v0"),
    _tree("NavigateAny", "MagWire/NavigateAny-v0", split="test", episodes=500),
    _tree("NavigateAny ood", "MagWire/NavigateAny-v0", split="ood", models="NavigateAny", episodes=500),
    _tree("Recover", "MagWire/Recover-v0", "RecoverRoute", split="test"),
    _tree("Gentle", "MagWire/Gentle-v0", split="test"),
    _tree("Uniform", "MagWire/Uniform-v0", split="test"),
    Arena(
        "SteerFree", "MagWire/SteerFree-v0", episodes=100, controllers=("MaxForce", "NetForce", *_STILL),
        reference="MaxForce",
    ),
    Arena(
        "Shape", "MagWire/Shape-v0", episodes=100, controllers=("InverseShape", *_STILL), reference="InverseShape"
    ),
)  # fmt: skip
"""An arena for every task of a free wire, and the trees out of distribution."""

FREE_LEARNERS: tuple[Learner, ...] = (
    Learner("ppo", tuple(a.name for a in FREE_ARENAS if a.models is None), 3),
    Learner("sac", ("Navigate", "SteerFree", "Shape"), 1),
)
"""PPO everywhere; SAC where it needs no teacher, with one seed."""
