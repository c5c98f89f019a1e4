"""The native batch: the core's lanes as a Gymnasium vector env, with autoreset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from ..physics.checks import one_of, whole
from ..simulation import Simulator
from . import renderer
from .core import SteeringCore
from .shown import Observation, of_lane
from .spec import SpecWithLimit
from .task import Task

if TYPE_CHECKING:
    from ..render.frames import Frames

__all__ = ["MagWireVectorEnv"]

_NONE = np.empty(0, dtype=np.int64)


class MagWireVectorEnv(SpecWithLimit, VectorEnv[Any, np.ndarray, np.ndarray]):  # type: ignore[misc]
    """`MagWireEnv` over many lanes at once; lane i of a batch seeded s is the single env seeded s + i.

    num_envs : number of lanes
    autoreset_mode : ``AutoresetMode.NEXT_STEP`` (default), ``SAME_STEP`` or ``DISABLED`` (with
        ``options["reset_mask"]``), as Gymnasium's vector API defines them
    scenario : also a sequence of `num_envs` scenarios, one a lane
    threads : threads a step may use; by default all cores for large batches
    max_episode_steps : episodes are also truncated after so many steps, as by `gym.make`'s wrapper; -1 for none
    render_mode, render_lanes : "rgb_array", and the lanes `render` draws, by default all (which Gymnasium's
        `RecordVideo` for batches asks for)

    Other arguments, observation, action, reward and info as `MagWireEnv`'s. In SAME_STEP mode
    `final_observation` holds the last step's observations before any reset, of all lanes.
    """

    def __init__(
        self,
        num_envs: int = 1,
        task: str | Task = "MagWire/Steer-v0",
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        render_mode: str | None = None,
        render_lanes: Sequence[int] | None = None,
        max_episode_steps: int | None = None,
        **settings: Any,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode must be None or 'rgb_array' for a batch, got {render_mode!r}")
        if not isinstance(autoreset_mode, AutoresetMode):
            autoreset_mode = AutoresetMode(one_of("autoreset_mode", autoreset_mode, [m.value for m in AutoresetMode]))
        self.autoreset_mode = autoreset_mode
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 10, "autoreset_mode": autoreset_mode}
        self.core = SteeringCore(task, num_envs, threads=threads, **settings)
        self.num_envs = num_envs
        self._most_steps = self.core.step_limit
        if max_episode_steps not in (None, -1):
            self._most_steps = min(whole("max_episode_steps", max_episode_steps, 1), self._most_steps)
        self.single_observation_space = self.core.shown.space
        self.single_action_space = self.core.actuation.space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.render_mode = render_mode
        self.generators: list[np.random.Generator | None] = [None] * num_envs
        """Each lane's random source."""
        self.began: list[dict[str, Any]] = [{}] * num_envs
        """The states that the generators were in when the running episodes began."""
        self._ended = np.ones(num_envs, dtype=np.bool_)
        self._started = False
        self.final_observation: Observation | None = None
        self._render_lanes = tuple(range(num_envs) if render_lanes is None else render_lanes)
        if bad := [lane for lane in self._render_lanes if not 0 <= lane < num_envs]:
            raise ValueError(f"render_lanes must lie in [0, {num_envs - 1}], got {bad[0]}")
        self._frames: Frames | None = None
        if render_mode is not None:
            self._frames = renderer.frames(self.core)

    @property
    def max_episode_steps(self) -> int:
        """Control steps of an episode at most."""
        return self._most_steps

    @property
    def simulator(self) -> Simulator:
        """The simulator of all lanes."""
        return self.core.sim

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start episodes, in the lanes of ``options["reset_mask"]`` or in all."""
        options = dict(options or {})
        lanes = np.arange(self.num_envs)
        if "reset_mask" in options:
            lanes = np.flatnonzero(self._mask(options.pop("reset_mask")))
        if seed is not None:
            one = isinstance(seed, (int, np.integer)) and not isinstance(seed, bool)
            self._seed([int(seed) + i for i in range(self.num_envs)] if one else list(seed), lanes)  # type: ignore
        self._begin(lanes, options)
        self._started = True
        mask = np.zeros(self.num_envs, dtype=np.bool_)
        mask[lanes] = True
        return self.core.observe(), _masked(self.core.start_info(), mask)

    def step(self, actions: np.ndarray) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One control period of every lane. Raises `ValueError` for NaN or a wrong shape, before anything moves."""
        if not self._started:
            raise gym.error.ResetNeeded("reset() must be called before step()")
        if self.autoreset_mode == AutoresetMode.DISABLED and self._ended.any():
            raise gym.error.ResetNeeded(
                f"lane {int(np.flatnonzero(self._ended)[0])} has ended: reset it with options={{'reset_mask': …}} first"
            )
        again = self._ended.nonzero()[0] if self.autoreset_mode == AutoresetMode.NEXT_STEP else _NONE
        reward, terminated, truncated, info = self.core.step(actions)
        if self._most_steps < self.core.step_limit:
            truncated |= self.core.steps >= self._most_steps
        if len(again):
            reward[again] = 0.0
            terminated[again] = truncated[again] = False
        self._ended = terminated | truncated
        done = self._ended.nonzero()[0]
        spoken = np.ones(self.num_envs, dtype=np.bool_)
        spoken[again] = False
        infos = _masked(info, spoken)
        if len(done):
            infos["summary"], infos["_summary"] = _masked(self.core.summary(done), self._ended), self._ended.copy()
        if len(again):
            self._begin(again, {})
        observation = self.core.observe()
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            self.final_observation = observation
            if len(done):
                infos = self._same_step(done, observation, infos, info)
                self._begin(done, {})
                observation = self.core.observe()
        return observation, reward, terminated, truncated, infos

    def render(self, lanes: Sequence[int] | None = None) -> tuple[np.ndarray, ...] | None:
        """The present frames of `lanes` (by default `render_lanes`), (480, 640, 3) uint8 each, under "rgb_array"."""
        if self._frames is None:
            gym.logger.warn('render() does nothing without render_mode: gym.make_vec(…, render_mode="rgb_array")')
            return None
        if not self._started:
            raise gym.error.ResetNeeded("reset() must be called before render()")
        return tuple(self._frames.array(self._render_lanes if lanes is None else lanes))

    def _same_step(self, done: np.ndarray, observation: Observation, infos: dict, info: dict) -> dict[str, Any]:
        """The ended lanes' observation and info move to `final_obs` and `final_info`, as in Gymnasium's own batches."""
        ended = self._ended.copy()
        final = np.full(self.num_envs, None, dtype=object)
        for lane in done:
            final[lane] = of_lane(observation, lane)
        final_info = _masked(info, ended)
        final_info["summary"], final_info["_summary"] = infos["summary"], infos["_summary"]
        kept = _masked(info, ~ended) if not ended.all() else {}
        return kept | {"final_obs": final, "_final_obs": ended, "final_info": final_info, "_final_info": ended}

    def _begin(self, lanes: np.ndarray, options: dict[str, Any]) -> None:
        rngs = []
        for lane in lanes:
            rng = self.generators[lane]
            if rng is None:
                rng = self.generators[lane] = seeding.np_random(None)[0]
            self.began[lane] = dict(rng.bit_generator.state)
            rngs.append(rng)
        self.core.begin(lanes, rngs, options)
        if self._frames is not None:
            self._frames.forget(lanes)
        self._ended[lanes] = False

    def _seed(self, seeds: list[int | None], lanes: np.ndarray) -> None:
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed must be one number or {self.num_envs} (num_envs) of them, got {len(seeds)}")
        for lane in lanes:
            own = seeds[lane]
            self.generators[lane] = seeding.np_random(int(own) if isinstance(own, np.integer) else own)[0]

    def _mask(self, mask: Any) -> np.ndarray:
        if (
            not isinstance(mask, np.ndarray)
            or mask.shape != (self.num_envs,)
            or mask.dtype != np.bool_
            or not mask.any()
        ):
            raise ValueError(
                f"options['reset_mask'] must be a boolean array of shape ({self.num_envs},) with at least one True, "
                f"got {mask!r}"
            )
        return mask


def _masked(values: dict[str, np.ndarray], mask: np.ndarray) -> dict[str, Any]:
    """Gymnasium's form: beside every array `key` the mask `_key` of the lanes that have it."""
    infos: dict[str, Any] = dict(values)
    infos.update({f"_{key}": mask for key in values})
    return infos
