"""The scenario a run was made in, kept as text beside it, so that a file changed elsewhere changes no result."""

from __future__ import annotations

import hashlib
from typing import Any

from magwire_env.envs.task import TASKS
from magwire_env.scenario import Scenario

__all__ = ["digest", "settings_with", "text_for"]


def digest(text: str) -> str:
    """SHA-256 of a scenario's text, in hexadecimal."""
    return hashlib.sha256(text.encode()).hexdigest()


def text_for(task: str, scenario: str | Scenario | None) -> str | None:
    """TOML text of the scenario asked for, else of the task's own; None if the task draws one for every episode."""
    if scenario is not None:
        return (scenario if isinstance(scenario, Scenario) else Scenario.load(scenario)).dumps()
    own = TASKS[task].scenario if task in TASKS else None
    return None if own is None else own().dumps()


def settings_with(env: dict[str, Any], task: str, text: str | None, given: bool) -> dict[str, Any]:
    """Env settings with the scenario of `text`, unless that is what the task has by itself.

    text, given : as `text_for` gave it, and whether a scenario was asked for
    """
    if text is None:
        return dict(env)
    scenario = Scenario.loads(text, "the scenario kept with the run")
    own = TASKS[task].scenario if task in TASKS else None
    if not given and own is not None and own() == scenario:
        return dict(env)
    return env | {"scenario": scenario}
