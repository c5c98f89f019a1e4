"""Scenarios as TOML: from the tree of frozen values to text and back."""

from __future__ import annotations

import dataclasses
import tomllib
import types
import typing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..physics.magnets import BlockMagnet, CylinderMagnet, PointDipole
from .rig import Slide, Turn

if TYPE_CHECKING:
    from .scenario import Scenario

__all__ = ["from_file", "from_text", "text_of"]

_SHIPPED = Path(__file__).parents[1] / "scenarios"
_MOST_BYTES = 64 * 2**20
"""Size beyond which a scenario's file is refused unread."""


def text_of(scenario: Scenario) -> str:
    """The TOML text of a scenario."""
    import tomli_w

    return tomli_w.dumps(_to_toml(scenario))


def from_text(kind: type[Scenario], text: str, where: str) -> Scenario:
    """The scenario of a TOML text; `where` names it in errors. `ValueError` for what is unknown or impossible."""
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{where} is not valid TOML: {error}") from error
    except (RecursionError, ValueError) as error:  # brackets in brackets, whole numbers of thousands of digits
        raise ValueError(f"{where} is not valid TOML: {type(error).__name__}: {error}") from error
    return _from_toml(kind, tree, where)


def from_file(kind: type[Scenario], path: str | Path) -> Scenario:
    """The scenario of a TOML file or a shipped name; errors as `from_text`'s, and `FileNotFoundError`."""
    file = Path(path)
    if not file.suffix and not file.exists():
        names = sorted(p.stem for p in _SHIPPED.glob("*.toml"))
        if str(path) not in names:
            raise FileNotFoundError(
                f"no file {str(path)!r}, and no shipped scenario of that name; shipped: {', '.join(names)}"
            )
        file = _SHIPPED / f"{path}.toml"
    size = file.stat().st_size
    if size > _MOST_BYTES:
        raise ValueError(f"{file} is {size} bytes long, more than the {_MOST_BYTES} of a scenario")
    try:
        text = file.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{file} must be text in UTF-8: {error}") from error
    return from_text(kind, text, str(file))


_KINDS = {"block": BlockMagnet, "cylinder": CylinderMagnet, "point": PointDipole, "turn": Turn, "slide": Slide}
_KIND_OF = {cls: kind for kind, cls in _KINDS.items()}


def _to_toml(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        tree = {"kind": _KIND_OF[type(value)]} if type(value) in _KIND_OF else {}
        values = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        return tree | {name: _to_toml(inner) for name, inner in values.items() if inner is not None}
    if isinstance(value, tuple):
        return [_to_toml(v) for v in value]
    return value


def _from_toml(kind: Any, tree: Any, where: str) -> Any:
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType) and any(a in _KIND_OF for a in args):
        return _tagged(args, tree, where)
    if dataclasses.is_dataclass(kind):
        return _built(typing.cast(type, kind), tree, where)
    if origin is tuple:
        if not isinstance(tree, list):
            raise ValueError(f"{where} must be a list, got {tree!r}")
        inner = args[0] if len(args) == 2 and args[1] is Ellipsis else None
        items = [_from_toml(inner if inner else a, t, f"{where}[{i}]") for i, (t, a) in enumerate(_zip(tree, args))]
        return tuple(items)
    return tuple(tree) if isinstance(tree, list) else tree


def _zip(tree: list, args: tuple) -> list:
    return [(t, args[i] if i < len(args) else args[-1]) for i, t in enumerate(tree)]


def _tagged(allowed: tuple, tree: Any, where: str) -> Any:
    names = [_KIND_OF[a] for a in allowed if a in _KIND_OF]
    if not isinstance(tree, dict) or tree.get("kind") not in names:
        got = tree.get("kind") if isinstance(tree, dict) else tree
        raise ValueError(f"{where}.kind must be one of {', '.join(map(repr, names))}, got {got!r}")
    return _built(_KINDS[tree["kind"]], tree, where)


def _built(kind: type, tree: Any, where: str) -> Any:
    if not isinstance(tree, dict):
        raise ValueError(f"{where} must be a table, got {tree!r}")
    hints = typing.get_type_hints(kind)
    tree = {k: v for k, v in tree.items() if not (k == "kind" and kind in _KIND_OF)}
    fields = {f.name: f for f in dataclasses.fields(kind)}
    if unknown := sorted(set(tree) - set(fields)):
        raise ValueError(f"{where} has an unknown key {unknown[0]!r}; allowed: {', '.join(fields)}")
    for name, f in fields.items():
        if name not in tree and f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING:
            raise ValueError(f"{where} lacks the key {name!r}")
    for name, value in tree.items():
        wanted = hints[name]
        if wanted in (bool, str) and not isinstance(value, wanted):
            raise ValueError(
                f"{where}.{name} must be {'true or false' if wanted is bool else 'a string'}, got {value!r}"
            )
    values = {name: _from_toml(hints[name], value, f"{where}.{name}") for name, value in tree.items()}
    try:
        return kind(**values)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
