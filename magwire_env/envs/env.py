"""The single env: the batch core with one lane."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from ..simulation import Simulator
from . import renderer
from .core import SteeringCore
from .kernels import VALUE
from .shown import of_lane
from .spec import SpecWithLimit
from .task import Task

if TYPE_CHECKING:
    from ..render.frames import Frames, Window

__all__ = ["MagWireEnv"]

_REWARD, _SUCCESS, _TERMINATED, _TRUNCATED = VALUE.reward, VALUE.success, VALUE.terminated, VALUE.truncated


class MagWireEnv(SpecWithLimit, gym.Env[Any, np.ndarray]):  # type: ignore[misc]
    """Steer a magnetically actuated guidewire along a tract.

    ## Description
    An external permanent magnet turns about the y axis; it pulls the magnet at the tip of a soft wire along a winding
    tract (the paper's Sections III-C and IV). The wire is locked to the tract's centreline. The task `Steer-v0` is to
    bring the tip from just inside the tract to its end, as fast as possible and without pressing on the wall.

    ## Observation Space
    `Box(float32)`, by default these numbers; other channels by name with `observe=`, see
    `magwire_env.envs.observation.CHANNELS`. With `observe="fluoroscopy"` a `Dict` with an image,
    `Box(0, 255, (1, 84, 84), uint8)`, see `magwire_env.envs.fluoroscopy.Fluoroscopy`; channels that are asked for
    beside it are its "state".

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | tip arc length / tract length | -2 | 2 | 1 |
    | 1 | tip speed along the tract / 0.1 m/s | -10 | 10 | 1 |
    | 2 | drive along the tract / 10 mN | -10 | 10 | 1 |
    | 3 | magnetic force across the tract / 10 mN | -10 | 10 | 1 |
    | 4 | sin of the magnet's angle from home | -1 | 1 | 1 |
    | 5 | cos of the magnet's angle from home | -1 | 1 | 1 |
    | 6 | way left to the goal / tract length | -2 | 2 | 1 |

    ## Action Space
    `Box(-1, 1, (1,), float32)`: the angle to hold, ±1 ↔ home ± π rad. A servo turns the magnet there the short way
    round at π rad/s at most. Numbers beyond ±1 are clipped, NaN is refused. `action_mode="rate"` commands the turn
    instead, `"direction"` takes the angle's (cos, sin).

    ## Dynamics
    Algorithm 1 of the paper, see `magwire_env.simulation.locked.algorithm1`: 0.1 s a control step. With
    ``model="free"`` the wire is a rod in space that touches the wall, see `magwire_env.simulation.free`.

    ## Reward
    ``reward/progress`` 10 × the share of the way covered, ``reward/success`` 10 on reaching the goal, ``reward/time``
    −0.1 a step (an end without success before the time limit pays for the steps that were left too), ``reward/wall``
    −0.5 × newtons of wall force above the scenario's limit; every term is in `info`, the weights are arguments
    (`reward=RewardWeights(…)`). `reward="sparse"` is 1 on success and 0 otherwise.

    ## Starting State
    Tip at the wire's length ± 20 mm (0.10 m in the paper's scenario), magnet angle uniform over the circle, at rest.
    `reset(options=…)` sets `tip_arclength` (m), `target` (m), `magnet_angle` (rad; one entry a degree of freedom).

    ## Episode End
    Terminated when the tip passes the goal, 10 mm before the tract's end (`is_success`), or leaves the tract
    backwards. Truncated after 30 s (`time_limit`, s).

    ## Info
    Every step: `is_success`, `cost` (N, peak wall force above its limit; in mN·s, times the control period, in a task
    with a limit on an episode's cost, such as Gentle), `wall_force` (N, mean over the step),
    `path_ratio` (share of the way from start to goal covered), `distance` (m, way left), the reward's terms, and what
    the scenario's `variation` drew; of a wire that is fed `base_force` (N), `base_torque` (N·m) and `inserted_length`
    (m). At the end `summary`: `steps`,
    `time` (s; to the goal's crossing, interpolated inside the step), `peak_wall_force`, `mean_wall_force`,
    `peak_lateral_force` (N), `magnet_travel` (rad and m summed).

    ## Arguments
    scenario : `Scenario`, a TOML file or a shipped name; by default the task's. One without a certificate warns, once
    coupling : "force" or "wrench", in place of the scenario's
    model : the wire model, "locked" or "free", in place of the scenarios', those of a pool too
    action_mode : "angle", "rate", "direction" or "moment" (magnets that turn about y, then z); by default the task's
    observe : names of observation channels, "fluoroscopy" or a `Fluoroscopy`; by default the task's
    reward : "dense", "sparse", `RewardWeights` or a dict of some of them, such as ``{"success": 20}``
    time_limit : s; `spec.max_episode_steps` is the number of control steps in it
    safety : an episode ends, without success, when the wall force exceeds the scenario's limit
    split, pool_size : of the pool of certified scenarios that a generated task draws each episode's from; "train",
        "test" or "ood"
    render_mode : "rgb_array" (frames, 480 × 640 × 3) or "human" (a window); both need the extra `view`

    ## Version History
    * v0: first
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": 10}  # noqa: RUF012

    def __init__(self, task: str | Task = "MagWire/Steer-v0", render_mode: str | None = None, **settings: Any) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode must be None or one of {self.metadata['render_modes']}, got {render_mode!r}")
        self.core = SteeringCore(task, 1, threads=1, **settings)
        self.observation_space = self.core.shown.space
        self.action_space = self.core.actuation.space
        self.render_mode = render_mode
        self._running = False
        self._frames: Frames | None = None
        self._window: Window | None = None
        if render_mode is not None:
            self._frames = renderer.frames(self.core)

    @property
    def simulator(self) -> Simulator:
        """The simulator, one lane."""
        return self.core.sim

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; see Starting State for `options`."""
        super().reset(seed=seed)
        self.core.begin(np.zeros(1, dtype=np.int64), [self.np_random], options)
        self._running = True
        if self._frames is not None:
            self._frames.forget((0,))
            self._show()
        return of_lane(self.core.observe(), 0), self.core.start_info(0)

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One control period. Raises `ValueError` for NaN or a wrong shape, before anything moves."""
        if not self._running:
            raise gym.error.ResetNeeded("reset() must be called before step()")
        core = self.core
        values = core.advance(core.actuation.alone(action))[:, 0].tolist()
        success, terminated, truncated = values[_SUCCESS] > 0.0, values[_TERMINATED] > 0.0, values[_TRUNCATED] > 0.0
        info = core.info(values, success, 0)
        if self.render_mode == "human":
            self._show()
        if terminated or truncated:
            info["summary"] = {k: v[0].item() for k, v in core.summary(np.zeros(1, dtype=np.int64)).items()}
        return of_lane(core.observe(), 0), values[_REWARD], terminated, truncated, info

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """The present frame, (480, 640, 3) uint8, in the mode "rgb_array"; in "human" every step shows itself."""
        if self._frames is None:
            gym.logger.warn('render() does nothing without render_mode: gym.make(…, render_mode="rgb_array")')
            return None
        if not self._running:
            raise gym.error.ResetNeeded("reset() must be called before render()")
        if self.render_mode == "rgb_array":
            return self._frames.array()[0]
        self._show()
        return None

    def close(self) -> None:
        """Take the window away, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _show(self) -> None:
        if self.render_mode != "human" or self._frames is None:
            return
        if self._window is None:
            self._window = renderer.window(self._frames.size)
        self._window.show(self._frames.surface(0, renderer.present(self.core)[0]), self.metadata["render_fps"])
