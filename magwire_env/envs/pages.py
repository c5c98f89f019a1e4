"""A page for every task, as its env's docstring: made from the task, its channels and its rig when it is asked for.

``help(gym.make("MagWire/Chase-v0").unwrapped)`` prints one; ``python -m magwire_env.envs.pages`` prints them all.
"""

from __future__ import annotations

import inspect
import re
from functools import lru_cache
from textwrap import fill, indent
from typing import Any

from ..scenario import Current, Feed, Rig, Scenario, Twist
from ..scenario.rig import Slide, Turn
from .env import MagWireEnv
from .kinds import Kind
from .pools import example
from .rewards import TERMS, info_name
from .task import TASKS, Task
from .trees import FORESTS

__all__ = ["env_class", "make", "page"]

ABOUT = {
    "Steer": "Bring the tip from just inside the tract to its end: the paper's set-up (Sections III-C and IV).",
    "Steer-v1": "Bring the tip in along the paper's tract, and back out: the paper's set-up (Sections III-C and IV).",
    "Reach": "Bring the tip to a random target, either way along the paper's tract, and hold it there.",
    "Track": "Keep the tip on a reference that moves slowly to and fro along the paper's tract.",
    "SteerAny": "Steer along a tract never seen before, with the paper's fixed one-axis magnet.",
    "Orient": "Steer along a tract never seen before, with a fixed magnet that turns to any direction.",
    "Chase": "Steer along a tract never seen before, with a magnet that slides above it and follows the tip.",
    "Hard": "Steer along a tract never seen before, where the best command leaves less than 0.3 mN somewhere.",
    "Navigate": "Bring the tip of a wire that is fed into the aortic arch into the branch drawn for the episode.",
    "NavigateAny": "Bring the tip of a wire that is fed into a tree never seen before into the branch drawn for it.",
    "Recover": "Come out of a wrong branch of a tree never seen before, and go into the branch drawn for the episode.",
    "Gentle": "Bring the tip of a fed wire into the branch drawn for it in a narrow, unseen tree, and press gently.",
    "Uniform": "As NavigateAny, steered by coils that make a uniform field of any direction, with no magnet.",
    "SteerFree": "Drag a free wire by its tip to the end of the paper's tract, with a magnet that follows it.",
    "Shape": "Bring a clamped wire in free space into a wanted shape, by a uniform field of any direction.",
    "Dual": "Steer along a tract never seen before, with one turning magnet above it and one below.",
}
"""By a task's name, with its version where that asks something else, what it asks."""


_VERSIONS = {
    "MagWire/Steer-v1": "* v1: in and back out, holding the magnet at home passes v0; takes the magnet's direction, "
    "which has no seam half a turn from home\n* v0: first, the way in alone",
    "MagWire/SteerAny-v1": "* v1: only tracts that no held command crosses; shows how the magnet stands to the "
    "tract ahead, and turns it by rates\n* v0: first",
    "MagWire/Hard-v1": "* v1: first; only tracts that no held command crosses",
    **dict.fromkeys(
        ("MagWire/Orient-v1", "MagWire/Chase-v1", "MagWire/Dual-v1"),
        "* v1: shows how the magnets stand to the tract ahead, and moves them by rates; the tracts are those of v0\n"
        "* v0: first",
    ),
    "MagWire/Reach-v1": "* v1: starts and targets where the tip can stand, held for 2 s; the far end ends the episode; "
    "the way left is also shown finely; the magnet is turned by rates\n* v0: first",
    "MagWire/Track-v1": "* v1: the magnet starts where it holds the tip; the far end ends the episode; "
    "the magnet is turned by rates\n* v0: first",
    "MagWire/Steer-v0": "* v0: first. Holding the magnet at home passes it: see v1",
    "MagWire/SteerAny-v0": "* v0: first. More than half of its tracts are crossed by one held command: see v1",
}


class _Page:
    """A docstring that is made when it is read."""

    def __init__(self, task: str) -> None:
        self._task = task

    def __get__(self, instance: Any, owner: Any) -> str:
        return page(self._task)


def make(task: str, **settings: Any) -> MagWireEnv:
    """The single env of a task: what `gym.make` calls."""
    return env_class(task)(task, **settings)


@lru_cache
def env_class(task: str) -> type[MagWireEnv]:
    """`MagWireEnv` with the task's page as its docstring."""
    name = _class_name(task)
    return type(name, (MagWireEnv,), {"__doc__": _Page(task), "__module__": __name__, "__qualname__": name})


def _class_name(task: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in task.rpartition("/")[2])


def __getattr__(name: str) -> Any:
    """The classes by name, so that envs can be pickled."""
    for task in TASKS:
        if name == _class_name(task):
            return env_class(task)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


@lru_cache
def page(task_id: str) -> str:
    """The page of a registered task."""
    task = TASKS[task_id]
    scenario = _example(task)
    version = task_id.rpartition("/")[2]
    about = ABOUT.get(version) or ABOUT.get(version.rpartition("-")[0], f"The task {task_id}.")
    kind = task.kind
    asked, *more = _asked(kind)
    where = (
        f"A certified scenario of the pool {task.pool!r}, see "
        f"`magwire_env.{'envs.trees' if task.pool in FORESTS else 'quasistatic.pool'}`; which one depends on the "
        "seed and the episode's number alone. "
        if task.pool
        else ""
    )
    rewards = "\n".join(f"* ``{info_name(term.name)}``: {term.weight:g} {term.text}" for term in TERMS)
    sections = {
        "Description": [f"{asked} {_wire(kind, scenario)}", *more],
        "Observation Space": [
            "`Box(float32)`; other channels by name with `observe=`, see `magwire_env.envs.observation.CHANNELS`; "
            'images by `observe="fluoroscopy"`, see `magwire_env.envs.fluoroscopy`.',
            _observation_table(task, scenario),
        ],
        "Action Space": [_ACTIONS.format(task.action_mode), _action_table(scenario, task.action_mode)],
        "Dynamics": [
            f"The scenario's wire model, by default {_MODELS.get(scenario.model, repr(scenario.model))}: "
            f"{scenario.timing.control_period:g} s a control step."
        ],
        "Reward": [_REWARD, rewards],
        "Starting State": [
            f"{where}{kind.starts(task)} {_rig_starts(kind, scenario.rig)}Everything is at rest.",
            "`reset(options=…)` takes:",
            "\n".join(f"* `{name}`: {_option(name, kind, scenario.rig)}" for name in kind.takes),
        ],
        "Episode End": [
            f"{kind.ends(task)} {_lost(kind, scenario.rig)} With `safety=True` terminated, too, without success, when "
            f"the wall force exceeds the scenario's limit. Truncated after {task.time_limit:g} s."
        ],
        "Info, Arguments": [f"See `MagWireEnv`. {_told(kind)}"],
        "Version History": [_VERSIONS.get(task_id, "* v0: first")],
    }
    parts = [about]
    for title, paragraphs in sections.items():
        parts += [f"## {title}\n" + "\n\n".join(map(_filled, paragraphs))]
    return indent("\n\n".join(parts), "    ").strip() + "\n    "


_DRAGGED = (
    "The magnetic tip of a soft wire is pulled along a tract by {} outside; the wire is locked to the tract's "
    "centreline, and the coupling is {!r}, see `Scenario`."
)
_FED = (
    "The wire is a rod in space that touches the walls with friction and is fed from its base; its magnetic tip is "
    "turned by {} outside; see `magwire_env.simulation.free` and `magwire_env.envs.arenas`."
)
_CLAMPED = (
    "The wire is a rod in space, held at its base; its magnetic tip is turned by {} outside; see "
    "`magwire_env.envs.shapes` and `magwire_env.envs.arenas`."
)
_FREE = (
    "The wire is a rod in space that touches the tract's wall with friction; its magnetic tip, pulled and turned by "
    "{} outside, drags it; see `magwire_env.simulation.free`."
)
_MODELS = {
    "locked": "Algorithm 1 of the paper, see `magwire_env.simulation.locked.algorithm1`",
    "free": "the discrete elastic rod of `magwire_env.simulation.free`",
}
_ACTIONS = (
    "Numbers beyond ±1 are clipped, NaN is refused. A servo moves each degree of freedom to what is commanded at its "
    'limited speed, a turn the short way round. `action_mode=` says what the numbers command, here `"{}"` by default: '
    '`"angle"` where each degree of freedom is to stand, `"rate"` its motion in one control period, `"direction"` '
    '(cos, sin) of each turn from home and the rest as `"angle"`, `"moment"` the direction of each magnet\'s moment, '
    "in the world's axes and of any length; there slides follow the tip, coils take currents, and a feed takes a rate."
)
_REWARD = (
    'The sum of these terms, every one in `info`. Weights by `reward=RewardWeights(…)`; `reward="sparse"` is 1 on '
    "success and 0 otherwise; terms of your own by `reward_terms=`."
)


_PARAMETERS = re.compile(r"\w+(, \w+)* : ")
"""How a paragraph of a docstring begins that lists parameters."""


def _asked(kind: Kind) -> list[str]:
    """The paragraphs of a kind's docstring, each as one line: the first, and those that do not list its parameters."""
    first, *others = (inspect.getdoc(type(kind)) or "").split("\n\n")
    return [" ".join(text.split()) for text in (first, *(o for o in others if not _PARAMETERS.match(o)))]


def _wire(kind: Kind, scenario: Scenario) -> str:
    """What moves, and what moves it."""
    outside = _outside(scenario.rig)
    if kind.navigates:
        return _FED.format(outside)
    if kind.shapes:
        return _CLAMPED.format(outside)
    return _FREE.format(outside) if scenario.model == "free" else _DRAGGED.format(outside, scenario.coupling)


def _outside(rig: Rig) -> str:
    """What pulls and turns the tip."""
    magnets = ("", "a magnet")[len(rig.magnets)] if len(rig.magnets) < 2 else "magnets"
    return " and ".join(filter(None, (magnets, "coils" if rig.coils else "")))


def _rig_starts(kind: Kind, rig: Rig) -> str:
    """How the rig stands at the start; empty where the kind itself says it."""
    if type(kind).magnets is not Kind.magnets:
        return ""
    which = "The magnet stands" if len(rig.magnets) == 1 else "The magnets stand"
    where = "over the tip, its moment in any direction" if kind.navigates else "anywhere in the rig's range"
    magnets = f"{which} {where}. " if rig.magnets else ""
    return magnets + ("The coils have any currents in their range. " if rig.coils else "")


def _option(name: str, kind: Kind, rig: Rig) -> str:
    """What an option of `reset` is."""
    if name == "magnet_angle":
        numbers = "; ".join(f"{dof}, {_unit(one)}" for dof, one in zip(rig.names, rig.dofs, strict=True))
        return numbers + (". Slides and feed follow from the tip's start instead" if kind.navigates else "")
    if name == "target" and kind.navigates:
        return "the name of one of the tree's dead ends"
    if name == "target" and kind.shapes:
        return "a command of the rig, whose shape of the wire at rest is wanted"
    if name == "start":
        return '"inlet", a branch\'s name for its end, or (name, m along it)'
    return {"tip_arclength": "m, where the tip starts", "target": "m, where the goal is"}.get(name, "see the task")


def _lost(kind: Kind, rig: Rig) -> str:
    """When an episode ends early without success, see `kernels.judge`."""
    if kind.ends_far:
        return "Terminated, too, when the tip leaves the tract by either end."
    if rig.feed is not None:
        return "However far the wire is pulled back, that ends no episode."
    if rig.clamped:
        return "Terminated, too, when the tip comes behind the clamp."
    return "Terminated, too, when the tip leaves the tract backwards."


def _told(kind: Kind) -> str:
    """What `info` has in this kind of task alone."""
    if kind.navigates:
        return (
            "Besides, every step: `branch` and `astray` (m) of the tip, `wrong_entries`, `contact_mean` and "
            "`contact_peak` (mN); `reset` tells the `target` and all `targets` that may be drawn."
        )
    if kind.shapes:
        return "`reset` tells the `target`, nodes in m, and a `demonstration`, the command that makes that shape."
    return "`reset` tells the `target` (m)."


def _filled(text: str) -> str:
    """A paragraph or a list in lines of at most 110 characters; a table as it is."""
    if text.startswith("|"):
        return text
    return "\n".join(
        fill(line, 110, subsequent_indent="  " if line.startswith("* ") else "", break_on_hyphens=False)
        for line in text.split("\n")
    )


def _example(task: Task) -> Scenario:
    """A scenario with the task's rig."""
    if task.scenario is not None:
        return task.scenario()
    assert task.pool is not None
    return example(task.pool)


def _observation_table(task: Task, scenario: Scenario) -> str:
    from ..simulation import Simulator
    from .episodes import Episodes
    from .observation import CHANNELS, Observer

    sim = Simulator(scenario)
    observer = Observer(sim, Episodes(sim, task, 1), task.observe)
    rows = []
    for name in observer.names:
        part, channel = observer.part(name), CHANNELS[name]
        labels = [number.label for number in observer.numbers[part]]
        if any(labels):
            rows += [(str(part.start + i), f"`{name}`: {label}", channel.bound) for i, label in enumerate(labels)]
        else:
            count = part.stop - part.start
            numbers = str(part.start) if count == 1 else f"{part.start}–{part.stop - 1}"
            rows.append((numbers, f"`{name}`: {channel.text}", channel.bound))
    lines = [f"| {num} | {text} | -{bound:g} | {bound:g} | 1 |" for num, text, bound in rows]
    return "\n".join(["| Num | Observation | Min | Max | Unit |", "|-----|---|---|---|---|", *lines])


def _action_table(scenario: Scenario, mode: str) -> str:
    rows = moment_rows(scenario) if mode == "moment" else action_rows(scenario, mode)
    lines = [f"| {number} | {text} | -1 | 1 | {unit} |" for number, (text, unit) in enumerate(rows)]
    return "\n".join(["| Num | Action | Min | Max | ±1 stands for |", "|-----|---|---|---|---|", *lines])


def action_rows(scenario: Scenario, mode: str) -> list[tuple[str, str]]:
    """What every number of the action commands, in order, and what ±1 stands for."""
    rows = []
    for name, dof in zip(scenario.rig.names, scenario.rig.dofs, strict=True):
        unit = _unit(dof)
        if mode == "rate":
            what = "change" if isinstance(dof, Current) else "motion"
            rows.append((f"{what} of the {name}", f"{dof.speed * scenario.timing.control_period:.3g} {unit} a step"))
        elif isinstance(dof, Turn) and mode == "direction":
            rows += [(f"{part} of the {name} from home", f"home {dof.home:.4g} rad") for part in ("cosine", "sine")]
        elif isinstance(dof, Turn):
            rows.append((name, f"home {dof.home:.4g} rad ± π rad"))
        else:
            rows.append((name, f"{dof.low:.3g} and {dof.high:.3g} {unit}"))
    return rows


def _unit(dof: Any) -> str:
    return {Turn: "rad", Slide: "m", Feed: "m", Twist: "rad"}.get(type(dof), "A")


def moment_rows(scenario: Scenario) -> list[tuple[str, str]]:
    """As `action_rows`, of the action mode "moment"."""
    rows = []
    for m in range(len(scenario.rig.magnets)):
        rows += [(f"moment of magnet {m} along {axis}; its slides follow the tip", "a direction") for axis in "xyz"]
    rows += [
        (f"current of coil {c} along {coil.axis}", f"{coil.current.low:.3g} and {coil.current.high:.3g} A")
        for c, coil in enumerate(scenario.rig.coils)
    ]
    base = (("feed", "m", scenario.rig.feed), ("twist", "rad", scenario.rig.twist))
    return rows + [
        (name, f"{dof.speed * scenario.timing.control_period:.3g} {unit} a step") for name, unit, dof in base if dof
    ]


if __name__ == "__main__":
    for one in TASKS:
        print(f"# {one}\n\n{page(one)}\n")
