"""The TOML text of a scenario, for people: short lines, few of them, with units."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ..lumen.rooms import BoxWall
from ..physics.ranges import RANGES
from .sensing import Sensing, Variation
from .toml import KIND_OF

if TYPE_CHECKING:
    from .scenario import Scenario

__all__ = ["text_of"]

_WIDTH = 120
_PLAIN = (type(None), BoxWall)


def text_of(scenario: Scenario, lumen: str | None = None) -> str:
    """The text that `Scenario.save` writes; reading it gives an equal scenario.

    lumen : name of the file that holds the lumen, in place of the lumen itself

    Sensing and variation are left out where there is none of either, and the tract where a lumen says it.
    """
    lines = list(_table(scenario, ()))
    if lumen is not None:
        lines.insert(1, f"lumen = {json.dumps(lumen)}")
    return "\n".join(lines).lstrip("\n") + "\n"


def _table(part: Any, path: tuple[str, ...]) -> Iterator[str]:
    """The lines of a dataclass: its plain keys, then its tables."""
    keys, tables, lists = [], [], []
    for name, value in _entries(part):
        if len(path) < 1 and dataclasses.is_dataclass(value):
            tables.append((name, value))
        elif isinstance(value, tuple) and value and all(map(dataclasses.is_dataclass, value)) and len(path) == 1:
            lists.append((name, value))
        else:
            keys.append(_key(name, value, _unit(part, name)))
    if path and (keys or not lists):
        yield ""
        yield f"[{'.'.join(path)}]"
    yield from keys
    for name, value in tables:
        yield from _table(value, (*path, name))
    for name, values in lists:
        for value in values:
            yield ""
            yield f"[[{'.'.join((*path, name))}]]"
            yield from (_key(inner, v, _unit(value, inner)) for inner, v in _entries(value))


def _entries(part: Any) -> list[tuple[str, Any]]:
    """The fields that are written: not None, lists empty by default, no clamp, or sensing and variation of nothing."""
    own: list[tuple[str, Any]] = [("kind", KIND_OF[type(part)])] if type(part) in KIND_OF else []
    tree = getattr(part, "lumen", None)
    for field in dataclasses.fields(part):
        value = getattr(part, field.name)
        if tree is not None and (field.name == "tract" or (field.name == "lumen" and type(tree.wall) not in _PLAIN)):
            continue
        nothing = value is None or (value == () and field.default == ()) or (field.name == "clamped" and not value)
        if not nothing and not (isinstance(value, (Sensing, Variation)) and not value):
            own.append((field.name, value))
    return own


def _unit(part: Any, name: str) -> str:
    return RANGES.get(f"{type(part).__name__}.{name}", (0, 0, ""))[2]


def _key(name: str, value: Any, unit: str) -> str:
    note = f"  # {unit}" if unit else ""
    line = f"{name} = {_inline(value)}{note}"
    if len(line) <= _WIDTH or not isinstance(value, tuple):
        return line
    rows, row = [], ""
    for item in value:
        text = f"{_inline(item)},"
        if row and len(row) + 1 + len(text) > _WIDTH - 4:
            rows.append(row)
            row = ""
        row = f"{row} {text}" if row else text
    return "\n".join([f"{name} = [{note}", *(f"    {r}" for r in (*rows, row)), "]"])


def _inline(value: Any) -> str:
    if dataclasses.is_dataclass(value):
        return "{ " + ", ".join(f"{n} = {_inline(v)}" for n, v in _entries(value)) + " }"
    if isinstance(value, (tuple, list)):
        return "[" + ", ".join(map(_inline, value)) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)
