"""The inverse of the static rod as a controller: the command whose shape is wanted, found by least squares, and held."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.envs.channel import LENGTH_SCALE
from magwire_env.physics import FreeRod
from magwire_env.physics.checks import whole
from magwire_env.scenario import Scenario

from .base import Controller, Memory

__all__ = ["InverseShape"]


class InverseShape(Controller):
    """Finds the command that brings the rod at rest nearest to the wanted points, and goes there.

    Knows: the model (wire, tip magnet, rig) and the wanted points, `wanted_points`; not where the wire is. The search is
    `FreeRod.rig_for`: SciPy's least squares over equilibria of the static rod, from several starts.

    starts : of each search at most

    Attributes
    residual : (n,) m, the farthest of the wanted points from the shape found; NaN before an episode's first step
    """

    def __init__(self, env: gym.Env | gym.vector.VectorEnv, starts: int = 4, **settings: Any) -> None:
        super().__init__(env, **settings)
        self.starts, scenarios = whole("starts", starts, 1), self.core.sim.library.scenarios
        self._rods = [FreeRod(sc.wire, sc.tip, gravity=sc.gravity) for sc in scenarios]
        self.residual = np.full(self.core.sim.num_envs, np.nan)

    @classmethod
    def refusal(cls, scenario: Scenario) -> str:
        """As `Controller.refusal`."""
        inlet, along = scenario.tract.position(np.zeros(1))[0], scenario.tract.tangent(np.zeros(1))[0]
        if not scenario.rig.clamped or np.abs(np.r_[inlet, along - [1.0, 0.0, 0.0]]).max() > 1e-9:
            return "InverseShape needs a wire that is clamped at the origin along x, see Scenario.rig.clamped"
        return ""

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        sim = self.core.sim
        commands = sim.library.home[sim.lane_scenario] if state is None else state[0].copy()
        begun = np.ones(len(observation), dtype=np.bool_) if state is None else starts
        points = self.seen(observation, "wanted_points").astype(np.float64).reshape(len(observation), -1, 3)
        for lane in np.flatnonzero(begun).tolist():
            entry = sim.lane_scenario[lane]
            wanted = np.concatenate([np.zeros((1, 3)), points[lane] * LENGTH_SCALE])
            found = self._rods[entry].rig_for(wanted, sim.library.scenarios[entry].rig, starts=self.starts)
            commands[lane], self.residual[lane] = found.parameters, found.distance
        return self.core.actuation.action(commands), (commands,)
