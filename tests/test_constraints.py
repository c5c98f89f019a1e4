"""`constraints.txt` pins what an installation brings along, down to the last package."""

from __future__ import annotations

import importlib.metadata as installed
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

PINNED = Path(__file__).parents[1] / "constraints.txt"


def pins() -> dict[str, Version]:
    """Name → version of each line."""
    lines = [line.split("#")[0].strip() for line in PINNED.read_text(encoding="utf-8").splitlines()]
    found = [line.partition("==") for line in lines if line]
    assert all(mark for _, mark, _ in found)
    return {canonicalize_name(name): Version(version) for name, _, version in found}


def brought_along() -> set[str]:
    """The installed packages that magwire with all its extras asks for, and what these ask for in turn."""
    waiting: list[tuple[str, tuple[str, ...]]] = [("magwire-env", tuple(extras("magwire-env")))]
    seen: set[tuple[str, tuple[str, ...]]] = set()
    while waiting:
        if (one := waiting.pop()) in seen:
            continue
        seen.add(one)
        name, wanted = one
        for line in installed.requires(name) or []:
            needed = Requirement(line)
            if needed.marker is not None and not any(needed.marker.evaluate({"extra": e}) for e in ("", *wanted)):
                continue
            if present(needed.name):
                waiting.append((canonicalize_name(needed.name), tuple(sorted(needed.extras))))
    return {name for name, _ in seen} - {"magwire-env"}


def extras(name: str) -> list[str]:
    return installed.metadata(name).get_all("Provides-Extra") or []


def present(name: str) -> bool:
    try:
        installed.distribution(name)
    except installed.PackageNotFoundError:
        return False
    return True


def test_every_package_that_is_brought_along_is_pinned():
    needed = brought_along()
    assert len(needed) > 40
    assert needed - set(pins()) == set()


def test_each_line_pins_one_package_and_no_package_stands_twice():
    lines = [line for line in PINNED.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")]
    assert len(lines) == len(pins())
    assert lines[0].startswith("torch==")  # it is installed alone, before what depends on it
