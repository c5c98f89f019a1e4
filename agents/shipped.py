"""Trained policies that come with the package, in the safe form: ``agents/trained/<name>/`` and a manifest of them all.

A command takes such a policy as ``trained/<name>``, for example ``trained/Steer-v1``. `agents.cli.policies` lists them,
and fills the folder from those of runs.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .learning.stored import Stored

__all__ = ["FILES", "MANIFEST", "PREFIX", "SHIPPED", "Trained", "content", "digests", "folder_of", "manifest"]

SHIPPED = Path(__file__).parent / "trained"
"""The folder in the package."""

MANIFEST = "manifest.json"
PREFIX = "trained/"
"""Of the names that commands take."""

FILES = ("policy.json", "policy.safetensors")
"""Of a policy's folder."""

FORMAT = 1
"""Of the manifest."""


@dataclass(frozen=True)
class Trained:
    """An entry of the manifest.

    name : of the policy's folder
    task : id of the task that it was trained on, and plays
    sha256 : file → its SHA-256
    size : bytes of the files
    episodes : of the test, on the seeds that every evaluation uses
    success_rate : in it
    median_time_s : of the successful episodes; None without any
    median_rms_error_m : of a tracking task; None elsewhere
    score : mean against the par, failures as 0; None if it was not compared
    """

    name: str
    task: str
    algorithm: str
    seed: int
    timesteps: int
    sha256: dict[str, str]
    size: int
    episodes: int
    success_rate: float
    median_time_s: float | None
    median_rms_error_m: float | None
    score: float | None

    @classmethod
    def of(cls, stored: Stored) -> Trained:
        """The entry in a manifest. Raises `ValueError` naming what is wrong."""
        name, sums = stored.get("name", str), stored.part("sha256")
        if name in ("", ".", "..") or set(name) & set("/\\:"):
            raise ValueError(f"{stored.where}: name must be the name of a folder, got {name!r}")
        return cls(
            name, stored.get("task", str), stored.get("algorithm", str), stored.get("seed", int),
            stored.whole("timesteps"), {file: sums.get(file, str) for file in FILES}, stored.whole("size"),
            stored.whole("episodes", 1), float(stored.get("success_rate", int, float)),
            *(_number(stored, key) for key in ("median_time_s", "median_rms_error_m", "score")),
        )  # fmt: skip


def manifest(folder: Path | None = None) -> list[Trained]:
    """The policies of a folder by their manifest, in its order; none where there is no manifest.

    folder : by default the one in the package

    Raises `ValueError`, naming the file, for a manifest that is damaged or of another format.
    """
    path = (folder or SHIPPED) / MANIFEST
    if not path.is_file():
        return []
    from .learning.stored import read_json  # which needs safetensors, as every trained policy does

    stored = read_json(path)
    if stored.whole("format", 1) > FORMAT:
        raise ValueError(f"{path} is of format {stored.tree['format']}; this program reads up to {FORMAT}")
    return [Trained.of(part) for part in stored.parts("policies")]


def content(policies: list[Trained]) -> dict[str, Any]:
    """What a manifest of these policies holds, for JSON."""
    return {"format": FORMAT, "policies": [asdict(policy) for policy in policies]}


def folder_of(name: str) -> Path | None:
    """The folder of the shipped policy ``trained/<name>``; None for a text that does not begin like that.

    Raises `ValueError` for a policy that is not shipped, or whose files are not those that the manifest was made of.
    """
    if not name.startswith(PREFIX):
        return None
    known = {policy.name: policy for policy in manifest()}
    found = known.get(name.removeprefix(PREFIX))
    if found is None:
        names = ", ".join(PREFIX + one for one in known) or "it has none"
        raise ValueError(f"policy must be a folder or a trained policy of this version ({names}); got {name!r}")
    folder = SHIPPED / found.name
    if digests(folder) != found.sha256:
        raise ValueError(f"{folder} is damaged: its files are not those that {SHIPPED / MANIFEST} was made of")
    return folder


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of a policy's files, in hexadecimal; "" for one that is missing."""
    paths = {file: folder / file for file in FILES}
    return {f: hashlib.sha256(p.read_bytes()).hexdigest() if p.is_file() else "" for f, p in paths.items()}


def _number(stored: Stored, key: str) -> float | None:
    value = stored.get(key, int, float, type(None))
    if value is not None and not math.isfinite(value):
        raise ValueError(f"{stored.where}: {key} must be finite or null, got {value!r}")
    return None if value is None else float(value)
