"""Scenarios as TOML: written so that a person can read them, read so that a person need not write everything.

A file may begin from another one, ``base = "paper"``, and say only what differs: a table changes the keys it names, and
an entry of a list of tables (such as ``[[rig.magnets]]``) changes the base's entry of the same number if both lists are
equally long. A tract is given by its points, by a name (``named = "s_bend"``, with the arguments of that function of
`magwire_env.lumen.named`) or by a file (``file = "centreline.csv"``, with the arguments of `Tract.load`).
"""

from __future__ import annotations

import dataclasses
import inspect
import tomllib
import types
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..lumen.curve import Tract
from ..lumen.lumen import Lumen, Wall
from ..lumen.rooms import BoxWall
from ..physics.magnets import BlockMagnet, CylinderMagnet, PointDipole
from ..physics.profile import Profile
from .rig import Slide, Turn

if TYPE_CHECKING:
    from .scenario import Scenario

__all__ = ["KIND_OF", "from_file", "from_text"]

_SHIPPED = Path(__file__).parents[1] / "scenarios"
_MOST_BYTES = 64 * 2**20
"""Size beyond which a scenario's file is refused unread."""
_MOST_BASES = 8
"""Files that may begin from one another."""
_MOST_PROBLEMS = 12
"""Problems that one message names."""

_KINDS: dict[str, type] = {
    "block": BlockMagnet, "cylinder": CylinderMagnet, "point": PointDipole, "turn": Turn, "slide": Slide,
    "box": BoxWall,
}  # fmt: skip
KIND_OF = {cls: kind for kind, cls in _KINDS.items()}
"""Class → the `kind` that says in a file which of several classes a table is."""


def from_text(kind: type[Scenario], text: str, where: str, folder: Path | None = None) -> Scenario:
    """The scenario of a TOML text.

    where : names it in errors
    folder : where files are that it names; without one, it may name none

    Raises one `ValueError` for all that is missing, unknown or impossible.
    """
    tree = _tree(text, where)
    if "base" in tree:
        tree = _on_base(tree, where, folder, 1)
    problems: list[str] = []
    if isinstance(tree.get("tract"), dict):
        tree["tract"] = _tract(tree["tract"], f"{where}.tract", folder, problems)
    if isinstance(tree.get("lumen"), str):
        tree["lumen"] = _lumen(tree["lumen"], f"{where}.lumen", folder)
    made = _from_toml(kind, tree, where, problems)
    if not problems:
        try:
            made.check_placed()
        except ValueError as error:
            problems.append(f"{where}: {error}")
    if problems:
        more = len(problems) - _MOST_PROBLEMS
        raise ValueError("; ".join(problems[:_MOST_PROBLEMS]) + (f"; and {more} more" if more > 0 else ""))
    return made


def from_file(kind: type[Scenario], path: str | Path) -> Scenario:
    """The scenario of a TOML file or a shipped name; errors as `from_text`'s, and `FileNotFoundError`."""
    file = Path(path)
    if not file.suffix and not file.exists():
        file = _shipped(str(path))
    return from_text(kind, _content(file), str(file), file.parent)


def _shipped(name: str) -> Path:
    names = sorted(p.stem for p in _SHIPPED.glob("*.toml"))
    if name not in names:
        raise FileNotFoundError(f"no file {name!r}, and no shipped scenario of that name; shipped: {', '.join(names)}")
    return _SHIPPED / f"{name}.toml"


def _content(file: Path) -> str:
    size = file.stat().st_size
    if size > _MOST_BYTES:
        raise ValueError(f"{file} is {size} bytes long, more than the {_MOST_BYTES} of a scenario")
    try:
        return file.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{file} must be text in UTF-8: {error}") from error


def _tree(text: str, where: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{where} is not valid TOML: {error}") from error
    except (RecursionError, ValueError) as error:  # brackets in brackets, whole numbers of thousands of digits
        raise ValueError(f"{where} is not valid TOML: {type(error).__name__}: {error}") from error


# --- what a file need not say -----------------------------------------------------------------------------------------


def _on_base(tree: dict[str, Any], where: str, folder: Path | None, depth: int) -> dict[str, Any]:
    """The tree of the base with what `tree` changes; it is called as its file is unless it says otherwise."""
    base = tree.pop("base")
    if not isinstance(base, str):
        raise ValueError(f"{where}.base must be a shipped scenario's name or a file, got {base!r}")
    if depth > _MOST_BASES:
        raise ValueError(f"{where}.base must end somewhere: {_MOST_BASES} files begin from one another already")
    if Path(base).suffix:
        file = _beside(base, f"{where}.base", folder)
    else:
        try:
            file = _shipped(base)
        except FileNotFoundError as error:
            raise ValueError(f"{where}.base: {error}") from error
    below = _tree(_content(file), str(file))
    if "base" in below:
        below = _on_base(below, str(file), file.parent, depth + 1)
    if isinstance(below.get("tract"), dict) and "file" in below["tract"]:
        below["tract"]["file"] = str(file.parent / below["tract"]["file"])
    if {"tract", "rig", "variation"} & set(tree):
        # The clouds were taken for the base's own distances; what the file itself says comes on top.
        for mount in below.get("rig", {}).get("magnets", []):
            mount.pop("dipoles", None)
    if {"points", "named", "file"} & set(tree.get("tract", {})):
        below.pop("tract", None)
    return _merged(below, {"name": Path(where).stem} | tree)


def _merged(below: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """`below` with the keys of `own` in place of its own, tables key by key."""
    merged = dict(below)
    for key, value in own.items():
        merged[key] = _one_merged(below.get(key), value)
    return merged


def _one_merged(below: Any, own: Any) -> Any:
    if isinstance(below, dict) and isinstance(own, dict):
        return dict(own) if own.get("kind", below.get("kind")) != below.get("kind") else _merged(below, own)
    tables = [isinstance(x, list) and bool(x) and all(isinstance(y, dict) for y in x) for x in (below, own)]
    if all(tables) and len(below) == len(own):
        return [_one_merged(a, b) for a, b in zip(below, own, strict=True)]
    return own


def _beside(name: str, where: str, folder: Path | None) -> Path:
    """The file that a scenario names, from where it stands itself."""
    if folder is None:
        raise ValueError(f"{where} must not name a file in a text that is of no file itself, got {name!r}")
    path = folder / name
    if not path.is_file():
        raise ValueError(f"{where} must name a file, seen from the scenario's own folder; there is no {str(path)!r}")
    return path


def _tract(tree: dict[str, Any], where: str, folder: Path | None, problems: list[str]) -> Any:
    """The tract that a table names, or the table itself if it lists points."""
    ways = [way for way in ("points", "named", "file") if way in tree]
    if len(ways) > 1:
        problems.append(f"{where} must have one of points, named and file, got {' and '.join(ways)}")
        return None
    if ways not in (["named"], ["file"]):
        return tree
    arguments = dict(tree)
    name = arguments.pop(ways[0])
    if not isinstance(name, str):
        problems.append(f"{where}.{ways[0]} must be a string, got {name!r}")
        return None
    try:
        return _named(name, arguments) if ways == ["named"] else _loaded(name, arguments, where, folder)
    except ValueError as error:
        text = str(error)
        problems.append(text if text.startswith(where) else f"{where}: {text}")
    return None


def _lumen(name: str, where: str, folder: Path | None) -> Lumen:
    """The lumen of a .lumen file beside the scenario's."""
    if Path(name).name != name or Path(name).suffix != ".lumen":
        raise ValueError(f"{where} must be a table, or the name of a .lumen file beside it, got {name!r}")
    return Lumen.load(_beside(name, where, folder))


def _named(name: str, arguments: dict[str, Any]) -> Tract:
    from ..lumen.named import NAMED

    if name not in NAMED:
        raise ValueError(f"named must be one of {', '.join(map(repr, NAMED))}, got {name!r}")
    _refuse_unknown(arguments, NAMED[name])
    return NAMED[name](**arguments)


def _loaded(name: str, arguments: dict[str, Any], where: str, folder: Path | None) -> Tract:
    _refuse_unknown(arguments, Tract.load, "path")
    return Tract.load(_beside(name, f"{where}.file", folder), **arguments)


def _refuse_unknown(arguments: dict[str, Any], function: Any, *but: str) -> None:
    known = [name for name in inspect.signature(function).parameters if name not in but]
    if unknown := sorted(set(arguments) - set(known)):
        raise ValueError(f"the table has an unknown key {unknown[0]!r}; allowed here: {', '.join(known)}")


# --- from the tree to values ------------------------------------------------------------------------------------------
# A part that cannot be made adds to `problems` and is None, so that one message can name all of them.


def _from_toml(kind: Any, tree: Any, where: str, problems: list[str]) -> Any:
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if tree is None or (dataclasses.is_dataclass(kind) and isinstance(tree, typing.cast(type, kind))):
        return tree
    if origin in (typing.Union, types.UnionType) and types.NoneType in args and len(args) == 2:
        (kind,) = (a for a in args if a is not types.NoneType)
        if kind is Wall:
            return _tagged((BoxWall,), tree, where, problems)
        if kind is Profile and not isinstance(tree, dict):
            return tree  # a number is a profile that is constant
        return _from_toml(kind, tree, where, problems)
    if origin in (typing.Union, types.UnionType) and any(a in KIND_OF for a in args):
        return _tagged(args, tree, where, problems)
    if dataclasses.is_dataclass(kind):
        return _built(typing.cast(type, kind), tree, where, problems)
    if origin is tuple:
        if not isinstance(tree, list):
            problems.append(f"{where} must be a list, got {tree!r}")
            return None
        inner = args[0] if len(args) == 2 and args[1] is Ellipsis else None
        pairs = [(t, inner or (args[i] if i < len(args) else args[-1])) for i, t in enumerate(tree)]
        return tuple(_from_toml(a, t, f"{where}[{i}]", problems) for i, (t, a) in enumerate(pairs))
    return tuple(tree) if isinstance(tree, list) else tree


def _tagged(allowed: Sequence[Any], tree: Any, where: str, problems: list[str]) -> Any:
    names = [KIND_OF[a] for a in allowed if a in KIND_OF]
    if not isinstance(tree, dict) or tree.get("kind") not in names:
        got = tree.get("kind") if isinstance(tree, dict) else tree
        problems.append(f"{where}.kind must be one of {', '.join(map(repr, names))}, got {got!r}")
        return None
    return _built(_KINDS[tree["kind"]], tree, where, problems)


def _built(kind: type, tree: Any, where: str, problems: list[str]) -> Any:
    if not isinstance(tree, dict):
        problems.append(f"{where} must be a table, got {tree!r}")
        return None
    before = len(problems)
    hints = typing.get_type_hints(kind)
    tree = {k: v for k, v in tree.items() if not (k == "kind" and kind in KIND_OF)}
    fields = {f.name: f for f in dataclasses.fields(kind)}
    if unknown := sorted(set(tree) - set(fields)):
        what = f"an unknown key {unknown[0]!r}" if len(unknown) == 1 else f"unknown keys {_listed(unknown)}"
        problems.append(f"{where} has {what}; allowed: {', '.join(fields)}")
    required = [
        n for n, f in fields.items() if f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
    ]
    required += getattr(kind, "REQUIRED", ())
    missing = [name for name in required if name not in tree]
    if "lumen" in fields and not {"tract", "lumen"} & set(tree):
        missing.insert(1 if "name" in missing else 0, "tract")
    if missing:
        hint = '; base = "paper" takes all that is left out from there' if "tract" in fields else ""
        problems.append(f"{where} lacks the key{'s'[: len(missing) > 1]} {_listed(missing)}{hint}")
    values = {}
    for name in fields:
        if name not in tree:
            continue
        wanted, value = hints[name], tree[name]
        if wanted in (bool, str) and not isinstance(value, wanted):
            a_kind = "true or false" if wanted is bool else "a string"
            problems.append(f"{where}.{name} must be {a_kind}, got {value!r}")
            continue
        values[name] = _from_toml(wanted, value, f"{where}.{name}", problems)
    if len(problems) > before or any(value is None for value in values.values()):
        return None
    try:
        return kind(**values)
    except ValueError as error:
        problems.append(f"{where}: {error}")
    return None


def _listed(names: Sequence[str]) -> str:
    return ", ".join(map(repr, names))
