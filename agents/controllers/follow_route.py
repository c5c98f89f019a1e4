"""Controllers of fed wires in trees: the tip is turned along the route by the field, and the feed minds the wall."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.envs.channel import LENGTH_SCALE, WALL_SCALE
from magwire_env.envs.route_channels import ROUTE_OFFSETS
from magwire_env.physics.checks import in_range, non_negative, one_of, positive
from magwire_env.scenario import Scenario

from .base import Controller, Memory

__all__ = ["FollowRoute", "Forward", "Hold", "RecoverRoute", "needs_a_feed"]


_ON, _OFF = 0.97, 0.8
"""Cosines between the tip and the way ahead at which it feeds at full speed, and at its slowest."""


def needs_a_feed(name: str, scenario: Scenario) -> str:
    """Why a controller cannot serve a scenario without a feed; "" for one with it."""
    if scenario.rig.feed is None:
        return f"{name} needs a wire that is fed, and Scenario.rig.feed is None"
    return ""


class _Fed(Controller):
    """A controller of a fed wire under the action mode "moment": magnets or coils first, the feed next."""

    def __init__(self, env: gym.Env | gym.vector.VectorEnv, **settings: Any) -> None:
        super().__init__(env, **settings)
        one_of("action_mode", self.core.actuation.mode, ("moment",))
        rig = self.core.sim.library.scenarios[0].rig
        self._feed = 3 * len(rig.magnets) + len(rig.coils)
        self._size = self.core.actuation.space.shape[0]

    @classmethod
    def refusal(cls, scenario: Scenario) -> str:
        """As `Controller.refusal`."""
        return needs_a_feed(cls.__name__, scenario)


class Hold(_Fed):
    """Does nothing: the magnets stay as they are, the wire is not fed. Knows: nothing."""

    sees_nothing = True

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        return np.zeros((len(observation), self._size), dtype=np.float32), state


class Forward(_Fed):
    """Feeds the wire at full speed, with the magnets as they are, or turned to one direction. Knows: nothing.

    moment : (3,) direction of the moment, or of coils' currents; None leaves them as they are
    """

    sees_nothing = True

    def __init__(self, env: gym.Env | gym.vector.VectorEnv, moment: np.ndarray | None = None, **settings: Any) -> None:
        super().__init__(env, **settings)
        self._moment = np.zeros(3) if moment is None else np.asarray(moment, dtype=np.float64)

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        action = np.zeros((len(observation), self._size), dtype=np.float32)
        action[:, :3] = self._moment
        action[:, self._feed] = 1.0
        return action, state


class FollowRoute(_Fed):
    """Turns the field along the way to a point of the route ahead, and feeds the less the harder the wire presses.

    Knows: the route ahead, the tip's direction, the magnet's pose (its field is taken as a dipole's), and the wall's
    force: `route_from_magnet`, `tip_tangent`, `magnet_pose`, `contact`. No model of the wire.

    look : m ahead along the route of the point it steers for, of `ROUTE_OFFSETS`
    gain : by how much the field turns beyond that way, per unit by which the tip's direction is off it
    press : N, wall force at which it stops feeding; above it pulls back
    slowest : share of the full feed while the tip points elsewhere than to that point
    """

    def __init__(
        self,
        env: gym.Env | gym.vector.VectorEnv,
        look: float = 0.04,
        gain: float = 2.0,
        press: float = 0.4,
        slowest: float = 0.15,
        **settings: Any,
    ) -> None:
        super().__init__(env, **settings)
        if look not in ROUTE_OFFSETS[1:]:
            raise ValueError(f"look must be one of {ROUTE_OFFSETS[1:]} (in m), got {look!r}")
        self._look = ROUTE_OFFSETS.index(look)
        self.gain, self.press = non_negative("gain", gain), positive("press", press, "N")
        self.slowest = in_range("slowest", slowest, 0.0, 1.0)

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        action = np.zeros((len(observation), self._size), dtype=np.float32)
        action[:, :3] = self.directions(observation)
        action[:, self._feed] = self.feed(observation)
        return action, state

    def feed(self, observation: np.ndarray) -> np.ndarray:
        """The feed (n,), from 1 forwards to −1 backwards."""
        peak = self.seen(observation, "contact")[:, 1] * WALL_SCALE
        most = np.clip((self._straightness(observation) - _OFF) / (_ON - _OFF), self.slowest, 1.0)
        return np.clip(2.0 - 2.0 * peak / self.press, -1.0, most)

    def _straightness(self, observation: np.ndarray) -> np.ndarray:
        """The cosine (n,) of the tip's direction with the way to the point steered for, or with the route's direction
        there: the better of the two, since a tip that lies along the wall of a wide vessel need not be slow."""
        first = 3 * (len(ROUTE_OFFSETS) + self._look)
        along = self.seen(observation, "route_from_magnet")[:, first : first + 3]
        to_point = self._way(observation)[1]
        return np.maximum(to_point, (along * self.seen(observation, "tip_tangent")).sum(axis=1))

    def _way(self, observation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The unit way (n, 3) to the point steered for, and its cosine with the tip's direction (n,)."""
        away = self.seen(observation, "magnet_pose")[:, 3:] * LENGTH_SCALE
        points = self.seen(observation, "route_from_magnet")[:, : 3 * len(ROUTE_OFFSETS)] * LENGTH_SCALE
        way = points[:, 3 * self._look : 3 * self._look + 3] + away
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
        return way, (way * self.seen(observation, "tip_tangent")).sum(axis=1)

    def directions(self, observation: np.ndarray) -> np.ndarray:
        """What the magnet's moment, or the coils' currents, must be like, (n, 3): longest entry 1."""
        away = self.seen(observation, "magnet_pose")[:, 3:]
        way, _ = self._way(observation)
        field = way + self.gain * (way - self.seen(observation, "tip_tangent"))
        if self.core.sim.library.magnet_count:
            r = away / np.linalg.norm(away, axis=1, keepdims=True)
            field = 1.5 * (field * r).sum(axis=1, keepdims=True) * r - field  # the moment whose dipole field that is
        return field / np.maximum(np.abs(field).max(axis=1, keepdims=True), 1e-9)


class RecoverRoute(FollowRoute):
    """As `FollowRoute`, and pulls back when the tip is in a wrong branch, or has come no further for a while.

    Knows, beside what `FollowRoute` knows: the way back from a wrong branch, and the way left: `astray`,
    `distance_left`.

    back : control periods that it goes on pulling once the tip is on the route again
    patience : control periods without progress after which it pulls back by `back` periods
    """

    def __init__(self, env: gym.Env | gym.vector.VectorEnv, back: int = 4, patience: int = 12, **settings: Any) -> None:
        super().__init__(env, **settings)
        self.back, self.patience = back, patience

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        left = self.seen(observation, "distance_left")[:, 0]
        pulling, waited, least = state or (np.zeros(len(left)), np.zeros(len(left)), left)
        pulling, waited = np.where(starts, 0.0, pulling), np.where(starts, 0.0, waited)
        least = np.where(starts, left, least)
        nearer = left < least - 1e-3
        waited, least = np.where(nearer, 0.0, waited + 1.0), np.where(nearer, left, least)
        astray = self.seen(observation, "astray")[:, 0] > 0.0
        stuck = waited >= self.patience
        pulling = np.where(astray | stuck, float(self.back), np.maximum(pulling - 1.0, 0.0))
        waited = np.where(stuck | astray, 0.0, waited)
        least = np.where(stuck | astray, np.inf, least)
        action, _ = super().act(observation, None, starts, deterministic)
        action[:, self._feed] = np.where(pulling > 0.0, -1.0, action[:, self._feed])
        return action, (pulling, waited, least)
