"""Model-predictive path integral control: try noisy plans in the simulator and average the better ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.physics.checks import in_range, positive, whole
from magwire_env.simulation import Simulator, SimulatorState, Trajectories

from .base import Controller, Memory
from .command_table import CommandTable
from .seen import aim_seen, magnet_seen, tip_seen, way_seen

__all__ = ["MPPI", "MPPISettings"]

_BEFORE_THE_TIP = (-0.02, 0.0, 0.01, 0.02, 0.04)
"""The best commands for places this far ahead of the tip, m, are tried as constant plans."""

_LEADS = (0, 1, 2)
"""Plans of best commands along the predicted path run ahead of it by so many control periods."""

_GOOD = 0.2
"""The costs of this share of the plans, the best ones, set the scale of the temperature."""


@dataclass(frozen=True)
class MPPISettings:
    """The settings of `MPPI`.

    samples : number of plans tried in an iteration
    horizon : length of a plan, control periods
    iterations : rounds of trying and averaging in a decision
    knots : number of points of the horizon at which noise is drawn; it is linear between them
    temperature : of the weights, relative to the excess cost that the best fifth of the plans stays within
    noise : standard deviation of the widest noise, in the servo's travel in a control period
    finest : standard deviation of the finest noise over that of the widest; the others lie between in geometric steps
    seed : of the noise, which is the same for all lanes and decisions
    fade : weight of a tracking error over the weight of the error one control period earlier
    settle : a reaching task's target counts as reached within this share of the tolerance
    spacing : m between the places where best commands are tabulated
    """

    samples: int = 128
    horizon: int = 8
    iterations: int = 2
    knots: int = 4
    temperature: float = 0.05
    noise: float = 3.0
    finest: float = 0.01
    seed: int = 0
    fade: float = 0.8
    settle: float = 0.5
    spacing: float = 2e-3

    def __post_init__(self) -> None:
        for name, least in (("samples", 32), ("horizon", 2), ("iterations", 1), ("knots", 2), ("seed", 0)):
            whole(f"MPPISettings.{name}", getattr(self, name), least)
        for name, unit in (("temperature", ""), ("noise", ""), ("spacing", "m")):
            positive(f"MPPISettings.{name}", getattr(self, name), unit)
        for name in ("finest", "fade", "settle"):
            in_range(f"MPPISettings.{name}", positive(f"MPPISettings.{name}", getattr(self, name)), 0.0, 1.0)


class MPPI(Controller):
    """Tries noisy plans in the simulator from where the tip is seen to be, and averages the better ones.

    Knows: the model (the simulator under the scenario's nominal numbers), the tip's arc length and speed, where the
    magnets are, and what the task wants: the remaining distance, or the reference up to 2 s ahead.

    Each decision starts from the last plan, moved on by a period. MPPI tries it with noise, and also plans that hold or
    follow the commands of greatest net force, in every direction that the task may need; they lead it through places
    that only one command passes. A plan's weight is exp(−excess cost / temperature) (Williams et al.,
    "Information-theoretic model predictive control", 2018). Noises of many widths replace one tuned covariance. The
    cost is

    - steering: the time to the goal; beyond the horizon, the time at the speed of greatest net force (`CommandTable`);
      in a task that comes back, the time of the way back, too
    - reaching: the time away from the target, and beyond the horizon the time to it
    - tracking: the squared distance to the reference

    settings : an `MPPISettings`; or give single settings by name
    """

    plans_online = True

    def __init__(
        self, env: gym.Env | gym.vector.VectorEnv, settings: MPPISettings | None = None, **single: Any
    ) -> None:
        super().__init__(env)
        if settings is not None and single:
            raise ValueError(f"settings must not come with single ones, got {', '.join(single)}")
        self.settings = c = settings or MPPISettings(**single)
        sim, self._kind = self.core.sim, self.core.task.kind
        self._model = Simulator(sim.library.scenarios, sim.num_envs, lane_scenario=sim.lane_scenario)
        self._tables = [CommandTable(sim.library, c.spacing, direction) for direction in self._kind.directions]
        led = len(self._tables) * (len(_BEFORE_THE_TIP) + len(_LEADS))
        self._noise = _noise(c, c.samples - led, sim.dof)

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        sim, c = self._model, self.settings
        self._follow_assignments()
        tip, wires = self._wires(observation)
        aim = aim_seen(self, observation, sim.control_period * np.arange(1, c.horizon + 1))
        back = way_seen(self, observation) < 0.0
        first = self._tables[0].command(sim.lane_scenario, tip)
        if back.any():
            first = np.where(back[:, None], self._tables[1].command(sim.lane_scenario, tip), first)
        held = first[:, None].repeat(c.horizon, axis=1)
        plan = held if state is None else np.where(starts[:, None, None], held, state[0])
        path = tip[:, None].repeat(c.horizon, axis=1)
        for _ in range(c.iterations):
            plan, path = self._improved(plan, path, wires, tip, aim, back)
        action = self.core.actuation.action(plan[:, 0])
        return action, (np.concatenate([plan[:, 1:], plan[:, -1:]], axis=1),)

    # --- what is seen -----------------------------------------------------------------------------------------------

    def _follow_assignments(self) -> None:
        """Give the model's lanes the scenarios that the env's lanes now have."""
        now = self.core.sim.lane_scenario
        changed = np.flatnonzero(self._model.lane_scenario != now)
        if len(changed):
            self._model.assign(changed, now[changed])

    def _wires(self, observation: np.ndarray) -> tuple[np.ndarray, SimulatorState]:
        """Tips (n,) m, and the wires as estimated: at rest length behind the tip, all nodes at the tip's speed."""
        tip, speed = tip_seen(self, observation)
        self._model.reset(tip, magnet_seen(self, observation))
        return tip, self._model.state().replaced(velocities=speed[:, None])

    # --- what is tried ----------------------------------------------------------------------------------------------

    def _improved(
        self,
        plan: np.ndarray,
        path: np.ndarray,
        wires: SimulatorState,
        tip: np.ndarray,
        aim: np.ndarray,
        back: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """One iteration: plan (n, H, dof) and its path (n, H) m → a better plan and the best path found."""
        sim, c = self._model, self.settings
        speed, low, high = (limit[:, None, None] for limit in self.limits)
        noisy = plan[:, None] + self._noise * (speed * sim.control_period)
        tried = np.concatenate([noisy, self._led(tip, path)], axis=1)
        tried = np.where(sim.library.is_turn, tried, np.clip(tried, low, high))
        moves = sim.rollout(wires, tried)
        cost = self._cost(moves, tip, aim)
        if self._kind.returns:
            cost = self._cost_of_two_legs(moves, tip, aim, cost, back)
        rows, best, count = np.arange(len(tip)), cost.argmin(axis=1), noisy.shape[1]
        excess = cost[:, :count] - cost[:, :count].min(axis=1, keepdims=True)
        scale = c.temperature * np.quantile(excess, _GOOD, axis=1, keepdims=True)
        weights = np.exp(-excess / np.maximum(scale, 1e-12))
        weights /= weights.sum(axis=1, keepdims=True)
        mean = (weights[:, :, None, None] * tried[:, :count]).sum(axis=1)
        # Only noisy plans are averaged: where a plan of best commands is better, it is taken as it is.
        better = np.where((best < count)[:, None, None], mean, tried[rows, best])
        return better, moves.tip_arclength[rows, best]

    def _led(self, tip: np.ndarray, path: np.ndarray) -> np.ndarray:
        """Plans (n, E, H, dof) that hold the best command for a place ahead, or follow those along `path` (n, H) m."""
        c, entries, plans = self.settings, self._model.lane_scenario, []
        for table in self._tables:
            for ahead in _BEFORE_THE_TIP:
                plans.append(table.command(entries, tip + table.direction * ahead)[:, None].repeat(c.horizon, axis=1))
            for lead in _LEADS:
                at = np.minimum(np.arange(c.horizon) + lead, c.horizon - 1)
                plans.append(table.command(entries[:, None], path[:, at]))
        return np.stack(plans, axis=1)

    # --- what it is worth -------------------------------------------------------------------------------------------

    def _cost(self, moves: Trajectories, tip: np.ndarray, aim: np.ndarray) -> np.ndarray:
        """The cost of every plan, (n, K): s, or m² in a tracking task."""
        gap = aim[:, None] - moves.tip_arclength
        if self._kind.follows:
            return gap**2 @ self.settings.fade ** np.arange(gap.shape[2])
        entries, goal = self._model.lane_scenario[:, None], aim[:, -1:]
        end, speed = moves.tip_arclength[..., -1], moves.tip_velocity[..., -1]
        forth = self._tables[0]
        left = forth.time(entries, end + forth.coast[entries] * speed, goal)
        if self._kind.passes:
            return self._time_to_goal(gap, goal - tip[:, None], left) + (moves.tip_arclength < 0.0).sum(axis=2)
        band = self.settings.settle * self.core.task.tolerance
        # Far away the cost is the time, almost flat; the small slope makes every millimetre count.
        away = self._model.control_period * np.minimum((gap / band) ** 2, 1.0 + 0.1 * np.abs(gap) / band).sum(axis=2)
        return away + np.where(gap[..., -1] > 0, left, self._tables[1].time(entries, end, goal))

    def _cost_of_two_legs(
        self, moves: Trajectories, tip: np.ndarray, aim: np.ndarray, cost: np.ndarray, back: np.ndarray
    ) -> np.ndarray:
        """The cost of every plan (n, K), s, where a way back comes or is under way.

        cost : `_cost`, that of the way in alone
        back : (n,) the tip is on its way back
        """
        entries, goal, home = self._model.lane_scenario[:, None], aim[:, -1:], self._tables[1]
        final = self.core.episodes.final[:, None]
        end, speed = moves.tip_arclength[..., -1], moves.tip_velocity[..., -1]
        behind = home.time(entries, np.maximum(end + home.coast[entries] * speed, 0.0), final)
        gap = moves.tip_arclength - aim[:, None]
        returning = self._time_to_goal(gap, tip[:, None] - goal, behind)
        # A plan that passes the far goal within its horizon has the way back before it from where it ends.
        passed = gap.max(axis=2) >= 0.0
        horizon = self._model.control_period * moves.tip_arclength.shape[2]
        inward = np.where(passed, horizon + behind, cost + home.time(entries, goal, final))
        return np.where(back[:, None], returning, inward)

    def _time_to_goal(self, gap: np.ndarray, first: np.ndarray, left: np.ndarray) -> np.ndarray:
        """Time to the goal of plans, s; the crossing is timed within its period.

        gap : (n, K, H) m to the goal after every period; first : (n, 1) m, before the first one
        left : (n, K) s from the horizon's end to the goal
        """
        before = np.concatenate([np.broadcast_to(first[..., None], (*gap.shape[:2], 1)), gap[..., :-1]], axis=2)
        share = np.clip(before / np.maximum(before - gap, 1e-9), 0.0, 1.0)
        share[np.minimum.accumulate(before, axis=2) <= 0.0] = 0.0
        return share.sum(axis=2) * self._model.control_period + np.where(
            gap.min(axis=2) <= 0, 0.0, np.maximum(left, 0.0)
        )


def _noise(c: MPPISettings, count: int, dof: int) -> np.ndarray:
    """Noise (count, H, dof) in servo travels of a period: the first is 0, the others are pairs of opposite sign."""
    pairs = (count - 1) // 2
    width = c.noise * c.finest ** np.linspace(1.0, 0.0, pairs)
    drawn = np.random.default_rng(c.seed).standard_normal((pairs, c.knots, dof)) * width[:, None, None]
    at = np.linspace(0.0, c.knots - 1, c.horizon)
    shares = np.maximum(1.0 - np.abs(at[:, None] - np.arange(c.knots)), 0.0)  # weight of each knot in each period
    smooth = np.einsum("hk,pkd->phd", shares, drawn)
    return np.concatenate([np.zeros((1, c.horizon, dof)), smooth, -smooth])
