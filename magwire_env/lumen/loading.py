"""Reading a lumen from other tools' files: `Lumen.load` is the way in."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..kept import kept_folder
from ..physics.checks import one_of, positive, vector
from .lumen import Lumen
from .lumen_file import load_lumen, save_lumen

__all__ = ["LumenNote", "kept_lumens", "load"]

_VERSION = 2
"""Goes up when the same file gives another lumen: it is part of the cache's key."""


class LumenNote(UserWarning):
    """What was guessed, turned, capped or dropped when a lumen was read."""


def load(
    path: str | Path,
    unit: str | None = None,
    inlet: Any = None,
    invert: bool = False,
    radius: float | None = None,
    holes: str = "refuse",
    progress: bool | None = None,
    cache: bool = True,
) -> Lumen:
    """The lumen in a file or folder; see `Lumen.load`."""
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"no such file or folder: {path}")
    one_of("holes", holes, ("refuse", "close"))
    if radius is not None:
        radius = positive("radius", radius, "m")
    if inlet is not None and not isinstance(inlet, str):
        inlet = np.array(vector("inlet", inlet, 3, "the file's unit"))
    if path.suffix.lower() == ".lumen":
        return load_lumen(path)
    kept = _kept(
        path, (unit, inlet if inlet is None or isinstance(inlet, str) else inlet.tolist(), bool(invert), radius, holes)
    )
    if cache and kept.exists():
        try:
            lumen = load_lumen(kept)
        except ValueError:
            kept.unlink(missing_ok=True)  # a damaged copy: read the file itself
        else:
            _tell(path, lumen)
            return lumen
    from .assembling import Wish, assembled  # the readers' libraries, which a kept lumen does not need

    with _bar(progress, path.name) as advance:
        lumen = assembled(Wish(path, unit, inlet, bool(invert), radius, holes, [], advance))
    if cache:
        _keep(lumen, kept)
    _tell(path, lumen)
    return lumen


def _tell(path: Path, lumen: Lumen) -> None:
    if lumen.notes:
        warnings.warn(LumenNote(f"{path}: {'; '.join(lumen.notes)}"), stacklevel=4)


# --- cache and bar ----------------------------------------------------------------------------------------------------


def _kept(path: Path, arguments: tuple) -> Path:
    """Where the lumen of this content and these arguments is kept."""
    whole = hashlib.sha256(repr((_VERSION, path.suffix.lower(), arguments)).encode())
    files = sorted(f for f in path.iterdir() if f.is_file()) if path.is_dir() else [path]
    if path.suffix.lower() in (".mhd", ".nhdr"):
        files = [path, *sorted(f for f in path.parent.iterdir() if f.is_file() and f.stem == path.stem and f != path)]
    for f in files:
        whole.update(f.name.encode() if path.is_dir() else b"")
        with f.open("rb") as stream:
            while block := stream.read(1 << 20):
                whole.update(block)
    return kept_lumens() / f"{whole.hexdigest()[:32]}.lumen"


def kept_lumens() -> Path:
    """The folder of the lumens kept by their files' contents."""
    return kept_folder("lumens")


def _keep(lumen: Lumen, kept: Path) -> None:
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        save_lumen(lumen, kept)
    except OSError:  # a home that cannot be written to: it is read anew next time
        return


class _bar:
    """A progress bar on the terminal, or none."""

    def __init__(self, wanted: bool | None, name: str) -> None:
        self.bar: Any = None
        try:
            from tqdm import tqdm
        except ImportError:
            return
        self.bar = tqdm(
            total=100,
            desc=name,
            leave=False,
            disable=None if wanted is None else not wanted,
            bar_format="{l_bar}{bar}| {postfix}",
        )

    def __enter__(self) -> Callable[[float, str], None]:
        return self._advance

    def _advance(self, share: float, what: str) -> None:
        if self.bar is not None:
            self.bar.set_postfix_str(what, refresh=False)
            self.bar.update(round(100 * share) - self.bar.n)

    def __exit__(self, *_: object) -> None:
        if self.bar is not None:
            self.bar.close()
