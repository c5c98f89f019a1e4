"""The page in the browser: a scene to look round, a magnet to turn, policies to watch."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from ..scenario import Scenario
from .browser_scene import Scene3D
from .controls import HAND, Controls
from .dofs import dofs_of
from .extra import need
from .panels import History
from .snapshot import blend, snapshots

__all__ = ["Page"]

UPDATES = 30
"""Updates of the scene a second."""

_CHART_PERIOD = 0.2
"""s between updates of charts, numbers and the field lines of several magnets."""

_MOST_STEPS = 10
"""Control steps done at most between two updates: beyond, the page falls behind its clock and stays alive."""


class Page:
    """Serves the page, and runs one env for all who look at it.

    tasks : environment ids to choose from
    scenarios : name → scenario, or None for the task's own
    policies : name → what makes a policy (SB3's ``predict``) for an env; the hand on the magnet comes first by itself
    host, port : where to serve; only this machine can reach the default

    Whatever the page's visitors do arrives in `requests` and is done in the thread that calls `run`, which alone
    touches the env.
    """

    def __init__(
        self,
        tasks: Sequence[str],
        scenarios: Mapping[str, Scenario | None],
        policies: Mapping[str, Callable[[gym.Env], Any]],
        host: str = "127.0.0.1",
        port: int = 8080,
        seed: int = 0,
    ) -> None:
        viser = need("viser", "the page in the browser")
        self.tasks, self.scenarios, self.policies = tuple(tasks), dict(scenarios), dict(policies)
        self.server = viser.ViserServer(host=host, port=port, label="magwire", verbose=False)
        self.requests: queue.Queue[Callable[[], None]] = queue.Queue()
        self._stopped = threading.Event()
        self.seed, self.playing, self.speed, self.click = seed, False, 1.0, "turns"
        self.policy_name, self._policy_state = HAND, None
        self._policy: Any = None
        self.message, self.updates = "", 0
        self._clock, self._next_chart = 0.0, 0.0
        self.scenario: Scenario | None = None
        self.controls = Controls(self)
        self.open(self.tasks[0], next(iter(self.scenarios)))

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    # --- what a visitor can ask for ---------------------------------------------------------------------------------

    def open(self, task: str, scenario: str) -> None:
        """Another task or scenario: a new env, a new scene, the hand on the magnet."""
        settings: dict[str, Any] = {} if self.scenarios[scenario] is None else {"scenario": self.scenarios[scenario]}
        try:
            env = gym.make(task, disable_env_checker=True, **settings)
        except (ValueError, gym.error.Error) as error:
            self.message = str(error)
            return
        self.env, self.core = env, env.unwrapped.core  # type: ignore[attr-defined]
        self.task, self.scenario_name = task, scenario
        self.policy_name, self._policy = HAND, None
        self.scenario = None
        self.reset()

    def reset(self, options: dict[str, Any] | None = None) -> None:
        """A new episode, with the next seed; `options` as the env's."""
        self.observation, _ = self.env.reset(seed=self.seed, options=options)
        self.seed += 1
        self.before = self.now = snapshots(self.core)[0]
        self.command = self.now.magnet.copy()
        self.score, self.summary, self.success = 0.0, None, False
        self.past, self._policy_state, self._fresh = History(), None, True
        self.past.add(self.now)
        self._clock = 0.0
        if self.now.scenario != self.scenario:  # some tasks draw one for every episode
            self._build(self.now.scenario)

    def _build(self, scenario: Scenario) -> None:
        """The scene and the magnet's controls for a scenario."""
        self.scenario, self.dofs = scenario, dofs_of(scenario)
        self.server.scene.reset()
        self.scene = Scene3D(self.server, scenario)
        self.scene.show_lines(self.controls.lines.value)
        if self.scene.board is not None:
            self.scene.board.image.on_click(
                lambda event: self._ask(
                    lambda: self.click_map(np.array(event.ray_origin), np.array(event.ray_direction))
                )
            )
        self.controls.rig(scenario, self.now.magnet)

    def choose_policy(self, name: str) -> None:
        """Give the magnet to a policy, or to the hand; one that does not fit the task says why, and changes nothing."""
        self.message = ""
        if name != HAND:
            try:
                self._policy = self.policies[name](self.env)
                self._policy.predict(self.observation, episode_start=np.ones(1, dtype=np.bool_))
            except (ValueError, gym.error.Error) as error:
                self.message = f"{name} does not fit here: {error}"
                name = HAND
        self.policy_name, self._policy_state, self._fresh = name, None, True
        self.command = self.now.magnet.copy()

    def play(self, on: bool) -> None:
        """Let the time run, or hold it; after an episode's end, begin another."""
        if on and self.summary is not None:
            self.reset()
        self.playing, self._clock = on, 0.0

    def hold(self, dof: int, value: float) -> None:
        """The hand turns or moves the magnet: one degree of freedom to `value`, rad, m or A."""
        if self.policy_name != HAND:
            self.choose_policy(HAND)
        self.command[dof] = self.dofs[dof].towards(self.command[dof], value)

    def hold_all(self, values: Mapping[int, float]) -> None:
        """`hold` several degrees of freedom."""
        for dof, value in values.items():
            self.hold(dof, value)

    def click_map(self, origin: np.ndarray, direction: np.ndarray) -> None:
        """A ray from a click: the magnet turns to the map's angle there, or an episode starts from that point."""
        found = self.scene.board.hit(origin, direction) if self.scene.board is not None else None
        if found is None:
            return
        place, command = found
        if self.click == "turns":
            self.hold(0, command)
        else:
            goal = float(self.core.goal[0])
            options = {"tip_arclength": min(max(place, 0.0), 0.99 * goal), "magnet_angle": [command]}
            self.reset(options)

    def _ask(self, request: Callable[[], None]) -> None:
        self.requests.put(request)

    # --- the loop ---------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Serve until `stop`."""
        last = due = time.perf_counter()
        while not self._stopped.is_set():
            now = time.perf_counter()
            self.update(now - last)
            last = now
            # Due times follow one another evenly, so that late updates are made up for, a few of them at most.
            due = max(due + 1 / UPDATES, now - 3 / UPDATES)
            self._stopped.wait(max(0.0, due - time.perf_counter()))
        self.server.stop()

    def stop(self) -> None:
        """End `run`."""
        self._stopped.set()

    def update(self, elapsed: float) -> None:
        """One update of the page, `elapsed` s after the last."""
        while not self.requests.empty():
            self.requests.get()()
        period = self.core.sim.control_period
        if self.playing:
            self._clock += elapsed * self.speed
            for _ in range(_MOST_STEPS):
                if self._clock < period or self.summary is not None:
                    break
                self._clock -= period
                self.step()
            self._clock = min(self._clock, period)
            self.playing = self.summary is None
        share = self._clock / period if self.playing else 1.0
        # Shown is the moment between the last two steps: one control period late, but moving smoothly.
        self.shown = self.now if share >= 1.0 else blend(self.before, self.now, share)
        with self.server.atomic():
            self.scene.update(self.shown)
            self.controls.follow(self.shown, self.command)
        if time.perf_counter() >= self._next_chart:
            self._next_chart = time.perf_counter() + _CHART_PERIOD
            self.controls.report()
            self.scene.update_lines(self.shown)
        self.updates += 1

    def step(self) -> None:
        """One control period under the policy or the hand."""
        if self.policy_name == HAND or self._policy is None:
            action = self.core.actuation.action(self.command[None])[0]
        else:
            start = np.full(1, self._fresh)
            action, self._policy_state = self._policy.predict(
                self.observation, state=self._policy_state, episode_start=start, deterministic=True
            )
        self._fresh = False
        self.observation, reward, terminated, truncated, info = self.env.step(action)
        self.score += float(reward)
        self.before, self.now = self.now, snapshots(self.core)[0]
        self.past.add(self.now)
        if terminated or truncated:
            self.summary, self.success = info["summary"], bool(info["is_success"])
