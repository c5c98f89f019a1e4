"""The page in the browser: a scene to look round, a magnet to turn, policies to watch."""

from __future__ import annotations

import contextlib
import io
import math
import queue
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from ..scenario import Scenario
from .browser_scene import Scene3D
from .controls import CLICKS, HAND, Controls
from .dofs import dofs_of
from .extra import need
from .guard import Guard
from .panels import History
from .snapshot import blend, snapshots
from .thinking import Thinker, Thought

__all__ = ["Page"]

UPDATES = 30
"""Updates of the scene a second."""

_CHART_PERIOD = 0.2
"""s between updates of charts, numbers and the field lines of several magnets."""

SPEEDS = (0.1, 4.0)
"""Slowest and fastest, times real time."""

_AT_ONCE = 0.25
"""s that a decision may take before the page goes on without it."""

_MOST_STEPS = 10
"""Control steps done at most between two updates: beyond, the page falls behind its clock and stays alive."""


class Page:
    """Serves the page, and runs one env for all who look at it.

    tasks : environment ids to choose from
    scenarios : name → scenario, or None for the task's own
    policies : name → what makes a policy (SB3's ``predict``) for an env; the hand on the magnet comes first by itself
    host, port : where to serve; only this machine can reach the default

    Whatever the page's visitors do arrives in `requests` and is done in the thread that calls `run`, which alone
    moves the env. A policy is made, and first asked in an episode, in a thread of its own: `Optimal` plans for minutes.
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
        self.guard = Guard(host)
        # What viser says of itself is an address without the token.
        with self.guard.over_servers(), contextlib.redirect_stdout(io.StringIO()):
            self.server = viser.ViserServer(host=host, port=port, label="magwire", verbose=False)
        self.requests: queue.Queue[Callable[[], None]] = queue.Queue()
        self._stopped = threading.Event()
        self.seed, self.playing, self.speed, self.click = seed, False, 1.0, "turns"
        self.policy_name, self._policy_state = HAND, None
        self._policy: Any = None
        self._thinker, self._opener = Thinker(), Thinker()
        self._thought: Thought | None = None
        self._opening: Thought | None = None
        self._wanted = self.tasks[0], next(iter(self.scenarios))
        self._action: np.ndarray | None = None
        self.message, self.updates = "", 0
        self._clock, self._next_chart = 0.0, 0.0
        self.scenario: Scenario | None = None
        self.controls = Controls(self)
        self.task, self.scenario_name = self._wanted
        self.open(*self._wanted)
        while not self.settled(1.0):
            pass
        if not hasattr(self, "env"):
            self.server.stop()
            raise ValueError(self.message)

    @property
    def url(self) -> str:
        """Where the page is, with the token that opens it."""
        return self.guard.address(self.server.get_port())

    # --- what a visitor can ask for ---------------------------------------------------------------------------------

    def open(self, task: str, scenario: str) -> None:
        """Another task or scenario: a new env, a new scene, the hand on the magnet; until it is there, all goes on."""
        if task not in self.tasks or scenario not in self.scenarios:
            self._refuse("there is no such task or scenario")
            return
        self.message = ""
        settings: dict[str, Any] = {} if self.scenarios[scenario] is None else {"scenario": self.scenarios[scenario]}
        if self._opening is not None:
            self._opening.give_up()
        self._wanted = task, scenario
        self._opening = self._opener.think(task, lambda: gym.make(task, disable_env_checker=True, **settings))
        self._opening.wait(_AT_ONCE)
        self._enter()

    def _enter(self) -> None:
        """Go over to the env that was asked for, if it is there."""
        opening = self._opening
        if opening is None or not opening.wait():
            return
        self._opening = None
        try:
            env = opening.result()
        except Exception as error:
            self._refuse(_said(f"{opening.what} cannot be opened", error))
            return
        self.env, self.core = env, env.unwrapped.core  # type: ignore[attr-defined]
        self.task, self.scenario_name = self._wanted
        self._take(HAND)
        self.scenario = None
        self.reset()

    def _refuse(self, why: str) -> None:
        """Say why a wish is not done, and show what still stands."""
        self.message = why
        self.controls.restore()

    def reset(self, options: dict[str, Any] | None = None) -> None:
        """A new episode, with the next seed; `options` as the env's."""
        self.observation, _ = self.env.reset(seed=self.seed, options=options)
        self.seed += 1
        self.before = self.now = snapshots(self.core)[0]
        self.command = self.now.magnet.copy()
        self.score, self.summary, self.success = 0.0, None, False
        self.past, self._fresh = History(), True
        self.past.add(self.now)
        self._clock = 0.0
        if self.now.scenario != self.scenario:  # some tasks draw one for every episode
            self._build(self.now.scenario)
        self._take(self.policy_name, self._policy)

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
        if name != HAND and name not in self.policies:
            self._refuse("there is no such policy")
            return
        self.message = ""
        self.command = self.now.magnet.copy()
        self._take(name)

    def _take(self, name: str, policy: Any = None) -> None:
        """Have the hand or a policy steer from here on; a policy is first made, unless it is given, and asked."""
        if self._thought is not None:
            self._thought.give_up()
            policy = None  # that thread may still be at work on it
        self.policy_name, self._policy, self._policy_state, self._fresh = name, policy, None, True
        self._thought = self._action = None
        if name == HAND:
            return
        make, env, observation = self.policies[name], self.env, self.observation

        def first() -> tuple[Any, np.ndarray, Any]:
            made = make(env) if policy is None else policy
            start = np.ones(1, dtype=np.bool_)
            return made, *made.predict(observation, state=None, episode_start=start, deterministic=True)

        self._thought = self._thinker.think(name, first)
        self._thought.wait(_AT_ONCE)
        self._learn_result()

    def _learn_result(self) -> None:
        """Take over what the thread has found, if it is done."""
        thought = self._thought
        if thought is None or not thought.wait():
            return
        self._thought = None
        try:
            self._policy, self._action, self._policy_state = thought.result()
        except Exception as error:
            self.message = _said(f"{thought.what} does not fit here", error)
            self._take(HAND)

    @property
    def progress(self) -> str:
        """A line on what is being worked at; empty if nothing is."""
        now, lines = time.perf_counter(), []
        if self._opening is not None:
            lines.append(f"{self._opening.what} is being made ready, {now - self._opening.started:.0f} s")
        if self._thought is not None:
            lines.append(f"{self._thought.what} is planning, {now - self._thought.started:.0f} s; time stands still")
        return "; ".join(lines)

    def settled(self, seconds: float) -> bool:
        """Wait for at most `seconds` until nothing is being worked at; whether that is so."""
        until = time.perf_counter() + seconds
        for learn in (self._enter, self._learn_result):
            work = self._opening if learn == self._enter else self._thought
            if work is not None:
                work.wait(max(0.0, until - time.perf_counter()))
                learn()
        return self._opening is None and self._thought is None

    def set_speed(self, speed: float) -> None:
        """How fast time runs, times real time, within `SPEEDS`."""
        low, high = SPEEDS
        if not (isinstance(speed, (int, float)) and low <= speed <= high):
            self._refuse(f"the speed lies between {low:g} and {high:g}")
            return
        self.speed = float(speed)

    def set_click(self, what: str) -> None:
        """What a click on the map does, of `CLICKS`."""
        if what not in CLICKS:
            self._refuse("a click on the map does no such thing")
            return
        self.click = CLICKS[what]

    def play(self, on: bool) -> None:
        """Let the time run, or hold it; after an episode's end, begin another."""
        if on and self.summary is not None:
            self.reset()
        self.playing, self._clock = on, 0.0

    def hold(self, dof: int, value: float) -> None:
        """The hand turns or moves the magnet: one degree of freedom to `value`, rad, m or A."""
        if not (0 <= dof < len(self.dofs) and math.isfinite(value)):
            self.message = "the magnet cannot go there"
            return
        if self.policy_name != HAND:
            self.choose_policy(HAND)
        self.command[dof] = self.dofs[dof].towards(self.command[dof], value)

    def hold_all(self, values: Mapping[int, float]) -> None:
        """`hold` several degrees of freedom."""
        for dof, value in values.items():
            self.hold(dof, value)

    def click_map(self, origin: np.ndarray, direction: np.ndarray) -> None:
        """A ray from a click: the magnet turns to the map's angle there, or an episode starts from that point."""
        ray = np.concatenate([origin, direction])
        found = self.scene.board.hit(origin, direction) if self.scene.board and np.isfinite(ray).all() else None
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
            self._do(self.requests.get())
        self._enter()
        self._learn_result()
        period = self.core.sim.control_period
        if self.playing and self._thought is None:
            self._clock += elapsed * self.speed
            for _ in range(_MOST_STEPS):
                if self._clock < period or self.summary is not None or not self.playing:
                    break
                self._clock -= period
                self._step_or_stop()
            self._clock = min(self._clock, period)
            self.playing = self.playing and self.summary is None
        share = self._clock / period if self.playing and self._thought is None else 1.0
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

    def _do(self, wish: Callable[[], None]) -> None:
        """Do what a visitor asked for; what goes wrong there is said, and ends nothing."""
        try:
            wish()
        except Exception as error:
            self._refuse(_said("that could not be done", error))

    def _step_or_stop(self) -> None:
        """`step`; a policy that fails there gives the magnet back, and time is held."""
        try:
            self.step()
        except Exception as error:
            self.message = _said(f"{self.policy_name} failed", error)
            self._take(HAND)
            self.play(False)

    def step(self) -> None:
        """One control period under the policy or the hand."""
        if self.policy_name == HAND or self._policy is None:
            action = self.core.actuation.action(self.command[None])[0]
        elif self._action is not None:
            action, self._action = self._action, None
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


def _said(what: str, error: Exception) -> str:
    """A line for the visitor; with an error that nobody foresaw, its traceback for whoever runs the page."""
    if isinstance(error, (ValueError, gym.error.Error)):
        return f"{what}: {error}"
    traceback.print_exception(error, file=sys.stderr)
    return f"{what}: {type(error).__name__}: {error}"
