"""A folder that nodes share by a URL (``s3://bucket/bench``, ``file:///mnt/bench``), through fsspec."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from magwire_env.render.extra import need

__all__ = ["Shared", "is_url"]


def is_url(place: str | Path) -> bool:
    """Whether a place is a URL and no path."""
    return "://" in str(place)


class Shared:
    """Files and folders under a URL, by their names in it."""

    def __init__(self, url: str) -> None:
        need("fsspec", "a URL for results", "cluster")
        from fsspec.core import url_to_fs

        self._system, root = url_to_fs(url)
        self._root = root.rstrip("/")

    def pull(self, names: Iterable[str], folder: Path) -> None:
        """Copy what there is of `names`, files or folders, into `folder`."""
        for name in names:
            source = f"{self._root}/{name}"
            if self._system.exists(source):
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                self._system.get(source, str(folder / name), recursive=True)

    def push(self, names: Iterable[str], folder: Path) -> None:
        """Copy what there is of `names` from `folder`."""
        for name in names:
            if (folder / name).exists():
                target = f"{self._root}/{name}"
                self._system.makedirs(target.rpartition("/")[0], exist_ok=True)
                if (folder / name).is_dir() and self._system.exists(target):
                    self._system.rm(target, recursive=True)
                self._system.put(str(folder / name), target, recursive=True)

    def names(self, pattern: str) -> list[str]:
        """Names that match a pattern such as ``*/*.json``."""
        return [path[len(self._root) + 1 :] for path in self._system.glob(f"{self._root}/{pattern}")]
