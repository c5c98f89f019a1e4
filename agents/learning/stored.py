"""Reading JSON that may come from a stranger: every entry is looked at before it is used."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import gymnasium as gym

import magwire_env  # noqa: F401  (registers the ids)

__all__ = ["ENV_KEYS", "Stored", "read_json"]

_MOST_BYTES = 64 * 2**20
"""Size beyond which a JSON file is refused unread."""

ENV_KEYS = ("coupling", "action_mode", "observe", "reward", "time_limit", "safety", "split", "pool_size")
"""Arguments of an env that a file may set. A scenario stands in the file itself, and is never a path."""


def read_json(path: Path) -> Stored:
    """The object in a JSON file.

    Raises `FileNotFoundError`, or `ValueError` naming the file for one that is damaged, too large or no object.
    """
    if path.stat().st_size > _MOST_BYTES:
        raise ValueError(f"{path} is {path.stat().st_size} bytes long, more than the {_MOST_BYTES} that are read")
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is damaged or no JSON: {error}") from error
    return Stored(tree, str(path))


class Stored:
    """An object of a JSON file, whose entries are asked for with the kind they must be of.

    where : names the file in errors
    """

    def __init__(self, tree: Any, where: str) -> None:
        if not isinstance(tree, dict):
            raise ValueError(f"{where} must be an object, got {_short(tree)}")
        self.tree, self.where = tree, where

    def get(self, name: str, *kinds: type) -> Any:
        """The entry `name`, of one of `kinds`; bool is no int. Raises `ValueError` naming it."""
        if name not in self.tree:
            raise ValueError(f"{self.where} lacks the entry {name!r}")
        value = self.tree[name]
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            wanted = " or ".join(_WORDS[kind] for kind in kinds)
            raise ValueError(f"{self.where}: {name} must be {wanted}, got {_short(value)}")
        return value

    def part(self, name: str) -> Stored:
        """The object `name`."""
        return Stored(self.get(name, dict), f"{self.where}: {name}")

    def parts(self, name: str) -> list[Stored]:
        """The list of objects `name`."""
        return [Stored(one, f"{self.where}: {name}[{i}]") for i, one in enumerate(self.get(name, list))]

    def whole(self, name: str, least: int = 0) -> int:
        """The whole number `name`, of at least `least`."""
        value = self.get(name, int)
        if value < least:
            raise ValueError(f"{self.where}: {name} must be at least {least}, got {_short(value)}")
        return value

    def strings(self, name: str) -> tuple[str, ...]:
        """The list of strings `name`."""
        values = self.get(name, list)
        if bad := [v for v in values if not isinstance(v, str)]:
            raise ValueError(f"{self.where}: {name} must hold strings, got {_short(bad[0])}")
        return tuple(values)

    def one_of(self, name: str, allowed: Any) -> str:
        """The string `name`, one of `allowed`."""
        value = self.get(name, str)
        if value not in allowed:
            raise ValueError(f"{self.where}: {name} must be one of {', '.join(allowed)}; got {_short(value)}")
        return value

    def task(self) -> str:
        """The entry ``task``: an id that is registered under ``MagWire/``. A module in front of it is not imported."""
        value = self.get("task", str)
        if not value.startswith("MagWire/") or value not in gym.registry:
            raise ValueError(
                f"{self.where}: task must be the id of a registered MagWire/… task, got {_short(value)}; "
                "nothing was imported for it"
            )
        return value

    def env(self, name: str) -> dict[str, Any]:
        """The object `name` of plain env settings, each of `ENV_KEYS`."""
        settings = self.get(name, dict)
        if unknown := sorted(set(settings) - set(ENV_KEYS)):
            raise ValueError(f"{self.where}: {name} must set only {', '.join(ENV_KEYS)}; got {unknown[0]!r}")
        return settings


_WORDS = {
    str: "a string", int: "a whole number", float: "a number", bool: "true or false", list: "a list",
    dict: "an object", type(None): "null",
}  # fmt: skip


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}…"
