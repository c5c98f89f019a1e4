"""Kinds of task: how an episode begins, what its goal is, and which rule says that it is done. One object a kind.

A beginning is made from numbers drawn uniformly from [0, 1), (n, k), one row an episode; the scenario may differ from
episode to episode.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..quasistatic.standing import Standing, standing
from ..scenario import Scenario
from ..simulation import Library, Places
from .kernels import FOLLOW, HOLD, PASS

if TYPE_CHECKING:
    from .task import Task

__all__ = ["KINDS", "InAndOut", "Kind", "Reach", "ReachStanding", "Steer", "Track", "TrackStanding"]

_LEAST_WAY = 0.05
"""A target is at least this far from the start, m."""

_WAVES = 3


@dataclass(frozen=True)
class Kind:
    """A kind of task; subclass it for your own, and put an instance into `Task.kind`.

    name : for people
    rule : when an episode is done: `kernels.PASS`, the tip has passed the goal at any substep; `HOLD`, it has stayed
        within the tolerance for the task's hold; `FOLLOW`, not before the time limit
    draws : how many uniform numbers a beginning is made from
    navigates : the tip must find its way to a branch of a tree, see `magwire_env.envs.navigation`
    shapes : the whole wire must come into a shape, see `magwire_env.envs.shapes`; the way left is how far off it is
    returns : having passed the goal, the tip must come back to `final`, and pass that place
    ends_far : the episode ends when the tip leaves the tract by its far end, as it does at the inlet
    directions : the ways along the tract a wire may have to go, 1 forwards and −1 backwards
    takes : options of `reset` that make sense
    cost_limit : mN·s, what the `cost` of an episode should stay below; None of a task that has no such limit
    """

    name: ClassVar[str]
    rule: ClassVar[int]
    draws: ClassVar[int]
    navigates: ClassVar[bool] = False
    shapes: ClassVar[bool] = False
    returns: ClassVar[bool] = False
    ends_far: ClassVar[bool] = False
    directions: ClassVar[tuple[int, ...]] = (1,)
    takes: ClassVar[tuple[str, ...]] = ("tip_arclength", "target", "magnet_angle")
    cost_limit: ClassVar[float | None] = None

    @property
    def follows(self) -> bool:
        """Whether the goal moves along a reference."""
        return self.rule == FOLLOW

    @property
    def passes(self) -> bool:
        """Whether the task is done once the tip has passed the goal, so that the way left has a sign."""
        return self.rule == PASS

    @property
    def holds(self) -> bool:
        """Whether the goal must be held for a while."""
        return self.rule == HOLD

    def begin(self, task: Task, library: Library, entries: np.ndarray, drawn: np.ndarray) -> tuple[Places, Places]:
        """Where the tips of the scenarios `entries` (n,) start, and where their goals are."""
        raise NotImplementedError

    def final(self, task: Task, library: Library, entries: np.ndarray) -> np.ndarray:
        """Where the way back of the scenarios `entries` (n,) ends, (n,) m; of a kind that returns."""
        raise ValueError(f"only a task that comes back has a final goal, got the task {task.id}")

    def magnets(self, library: Library, entries: np.ndarray, start: np.ndarray) -> np.ndarray | None:
        """Where the rigs of the scenarios `entries` (n,) stand at the start, (n, dof); None for anywhere.

        start : (n,) m, of the tips
        """
        return None

    def ways(self, task: Task, scenario: Scenario) -> tuple[tuple[int, float | None], ...]:
        """What must be certified for a scenario: directions, and where each way ends, m (None: as `certificate`)."""
        return tuple((direction, None) for direction in self.directions)

    def starts(self, task: Task) -> str:
        """For people: where an episode starts."""
        return "The tip starts where the task puts it."

    def ends(self, task: Task) -> str:
        """For people: when an episode is done."""
        near = f"{1e3 * task.tolerance:g} mm"
        return {
            PASS: "Terminated when the tip passes the goal (`is_success`).",
            HOLD: f"Terminated when the tip has stayed within {near} of the goal for {task.hold:g} s (`is_success`); "
            '`summary["time"]` runs to the end of the holding.',
            FOLLOW: f"`is_success` at the end if the RMS error is at most {near}; "
            '`summary["rms_error"]` in m, `path_ratio` is 1 − error/tolerance.',
        }[self.rule]

    def reference(
        self, task: Task, library: Library, entries: np.ndarray, drawn: np.ndarray, times: np.ndarray
    ) -> np.ndarray:
        """The moving goal at `times` s after the start, (n, len(times)) m; of a kind that follows one."""
        raise ValueError(f"only a tracking task has a reference, got the task {task.id}")


@dataclass(frozen=True)
class Steer(Kind):
    """Drive the tip from the inlet to the end."""

    name: ClassVar[str] = "steer"
    rule: ClassVar[int] = PASS
    draws: ClassVar[int] = 1

    def begin(self, task: Task, library: Library, entries: np.ndarray, drawn: np.ndarray) -> tuple[Places, Places]:
        """As `Kind.begin`."""
        start = library.start_length[entries] + task.start_spread * (2 * drawn[:, 0] - 1)
        start = np.clip(start, *library.reach[entries].T)
        return Places(start), Places(library.tract_length[entries] - task.goal_margin)

    def starts(self, task: Task) -> str:
        """As `Kind.starts`."""
        return (
            f"The tip starts at the wire's length ± {1e3 * task.start_spread:g} mm; the goal lies "
            f"{1e3 * task.goal_margin:g} mm before the tract's end."
        )


@dataclass(frozen=True)
class InAndOut(Steer):
    """Drive the tip from the inlet to the end, and back out.

    beyond : m; the way back ends this far before the wire's whole length is drawn out of the tract
    """

    name: ClassVar[str] = "in and out"
    returns: ClassVar[bool] = True
    directions: ClassVar[tuple[int, ...]] = (1, -1)
    takes: ClassVar[tuple[str, ...]] = ("tip_arclength", "magnet_angle")
    beyond: float = 0.05

    def final(self, task: Task, library: Library, entries: np.ndarray) -> np.ndarray:
        """As `Kind.final`."""
        return library.wire_length[entries] + self.beyond

    def ways(self, task: Task, scenario: Scenario) -> tuple[tuple[int, float | None], ...]:
        """As `Kind.ways`."""
        return (1, None), (-1, scenario.wire.length + self.beyond)

    def starts(self, task: Task) -> str:
        """As `Kind.starts`."""
        return (
            f"{super().starts(task)} Once the tip has passed it, the goal lies {1e3 * self.beyond:g} mm beyond the "
            "wire's length, on the way back."
        )

    def ends(self, task: Task) -> str:
        """As `Kind.ends`."""
        return (
            "Terminated when the tip, after it has passed the far goal, passes the near one on its way back "
            '(`is_success`); `summary["time_in"]` and `["time_back"]` are the two legs. `distance` counts both legs.'
        )


@dataclass(frozen=True)
class Reach(Kind):
    """Drive the tip to a target either way, and hold it there."""

    name: ClassVar[str] = "reach"
    rule: ClassVar[int] = HOLD
    draws: ClassVar[int] = 2
    directions: ClassVar[tuple[int, ...]] = (1, -1)

    def begin(self, task: Task, library: Library, entries: np.ndarray, drawn: np.ndarray) -> tuple[Places, Places]:
        """As `Kind.begin`."""
        first, last = library.start_length[entries], library.tract_length[entries] - task.goal_margin
        last = np.minimum(last, library.reach[entries, 1])
        start = first + drawn[:, 0] * (last - first)
        below = np.maximum(start - _LEAST_WAY - first, 0.0)
        above = np.maximum(last - start - _LEAST_WAY, 0.0)
        way = drawn[:, 1] * (below + above)
        goal = np.where(way < below, start - _LEAST_WAY - way, start + _LEAST_WAY + way - below)
        return Places(start), Places(goal)

    def starts(self, task: Task) -> str:
        """As `Kind.starts`."""
        return (
            f"Tip and target are uniform between the wire's length and {1e3 * task.goal_margin:g} mm before the end of "
            f"the tract, at least {1e3 * _LEAST_WAY:g} mm apart."
        )


@dataclass(frozen=True)
class Track(Kind):
    """Keep the tip on a moving reference."""

    name: ClassVar[str] = "track"
    rule: ClassVar[int] = FOLLOW
    draws: ClassVar[int] = 8
    directions: ClassVar[tuple[int, ...]] = (1, -1)
    takes: ClassVar[tuple[str, ...]] = ("magnet_angle",)

    def begin(self, task: Task, library: Library, entries: np.ndarray, drawn: np.ndarray) -> tuple[Places, Places]:
        """As `Kind.begin`."""
        start = self.reference(task, library, entries, drawn, np.zeros(1))[:, 0]
        return Places(start), Places(start)

    def starts(self, task: Task) -> str:
        """As `Kind.starts`."""
        return (
            "The tip starts on the reference, a sum of three slow sines about a middle, drawn anew for every episode, "
            f"at most {1e3 * task.reference_speed:g} mm/s fast and always inside the tract."
        )

    def reference(
        self, task: Task, library: Library, entries: np.ndarray, drawn: np.ndarray, times: np.ndarray
    ) -> np.ndarray:
        """Slow waves about a middle, never beyond the tract.

        A sum of three sines with periods of 10 to 40 s; its amplitude is the largest that keeps it within the tract
        and its speed below the task's.
        """
        low, high = library.start_length[entries], library.tract_length[entries] - 2 * task.goal_margin
        high = np.minimum(high, library.reach[entries, 1])
        share = 0.5 + np.abs(drawn[:, 1 : 1 + _WAVES])
        share /= share.sum(axis=1, keepdims=True)
        pace = 2 * np.pi / (10.0 + 30.0 * drawn[:, 4 : 4 + _WAVES])
        starts = [drawn[:, 7], (3 * drawn[:, 7] + drawn[:, 1]) % 1, (5 * drawn[:, 7] + drawn[:, 2]) % 1]
        phase = 2 * np.pi * np.stack(starts, axis=1)
        size = np.minimum(task.reference_speed / (share * pace).sum(axis=1), 0.45 * (high - low))
        middle = low + size + drawn[:, 0] * (high - low - 2 * size)
        waves = share[:, :, None] * np.sin(pace[:, :, None] * times + phase[:, :, None])
        return middle[:, None] + size[:, None] * waves.sum(axis=1)


def _standing(library: Library, entries: np.ndarray) -> list[tuple[np.ndarray, Standing]]:
    """The rows (k,) of `entries` that have the same scenario, and where its tip can stand."""
    return [(np.flatnonzero(entries == e), standing(library.scenarios[e])) for e in np.unique(entries)]


@dataclass(frozen=True)
class ReachStanding(Reach):
    """Drive the tip to a target either way, and hold it there; it starts and ends where a magnet can hold it."""

    name: ClassVar[str] = "reach standing"
    ends_far: ClassVar[bool] = True

    def begin(self, task: Task, library: Library, entries: np.ndarray, drawn: np.ndarray) -> tuple[Places, Places]:
        """As `Kind.begin`: a place at which the tip cannot stand gives way to the nearest at which it can."""
        start, goal = (places.s for places in super().begin(task, library, entries, drawn))
        for rows, where in _standing(library, entries):
            start[rows], goal[rows] = where.nearest_good(start[rows]), where.nearest_good(goal[rows])
        return Places(start), Places(goal)

    def starts(self, task: Task) -> str:
        """As `Kind.starts`."""
        return f"{super().starts(task)} At both places some angle holds the tip, and others move it either way."


@dataclass(frozen=True)
class TrackStanding(Track):
    """Keep the tip on a moving reference; at the start the magnet holds it there."""

    name: ClassVar[str] = "track standing"
    ends_far: ClassVar[bool] = True

    def magnets(self, library: Library, entries: np.ndarray, start: np.ndarray) -> np.ndarray | None:
        """As `Kind.magnets`: the angle that holds the tip most firmly."""
        angles = np.empty((len(start), 1))
        for rows, where in _standing(library, entries):
            angles[rows, 0] = where.angle(start[rows])
        return angles

    def starts(self, task: Task) -> str:
        """As `Kind.starts`."""
        return f"{super().starts(task)} The magnet stands where it holds the tip most firmly."


KINDS: dict[str, Kind] = {
    kind.name: kind for kind in (Steer(), InAndOut(), Reach(), Track(), ReachStanding(), TrackStanding())
}
"""The kinds by name."""
