"""How kernels are compiled, and a compiled cache that cannot be stale.

Numba keeps machine code on disk under a stamp of the file that holds the function. A kernel also depends on the
functions it calls and the constants it reads, which stand in other files, so an edit there, or an upgrade in place,
would leave old code in use. The stamp here covers every source file a kernel may depend on: this one, those of the
kernel's own floor and of the floors below it, and those beside the kernel itself. The processor's name and features
are part of Numba's own key.

Numba writes its index before the machine code that the index names, and numbers that from 1 again under every stamp. So
a process that is killed in between, or one that still runs sources from before an edit, could leave old code under the
new stamp. Here the names of the files have the stamp in them.

A folder that cannot be written, and a cache file that is damaged, cost a compilation and never an error.
"""

from __future__ import annotations

import hashlib
import inspect
import pickle
import warnings
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from numba import njit
from numba.core import config
from numba.core.caching import FunctionCache, NullCache

__all__ = ["inlined", "kernel", "precise", "source_stamp"]

_FLAGS: dict[str, Any] = {
    "cache": False,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},
}
"""The default error model's check for division by zero would stop vectorisation; plain ``fastmath=True`` would make
checks for NaN undefined."""

_PACKAGE = Path(__file__).parent
_FLOORS = ("physics", "lumen", "scenario", "simulation", "quasistatic")
"""Folders from the ground up: by the import contracts, a kernel depends on its own floor and those below."""

_DAMAGE = (pickle.UnpicklingError, EOFError, OSError, AttributeError, ImportError, IndexError, KeyError, TypeError,
           ValueError, RuntimeError)  # fmt: skip
"""What a truncated or foreign cache file raises while it is read."""

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile `function` when it is first called, or load it from the cache of these very sources."""
    return _cached(function, njit(**_FLAGS)(function))


def precise(function: F) -> F:
    """As `kernel`, but the compiler may not reorder sums: for code that must be exact to the bit.

    That is said outright: Numba compiles a function that leaves it open by the flags of the caller that needs it first.
    """
    return _cached(function, njit(nogil=True, error_model="numpy", fastmath=False)(function))


def inlined(function: F) -> F:
    """As `kernel`, and the compiler puts the function's body in the place of every call."""
    return _cached(function, njit(**_FLAGS, forceinline=True)(function))


@lru_cache
def source_stamp(folder: Path) -> str:
    """A digest of every source file that a kernel in `folder` may depend on."""
    floors = [_PACKAGE / name for name in _FLOORS]
    own = next((i for i, floor in enumerate(floors) if folder.is_relative_to(floor)), len(floors))
    digest = hashlib.sha256(b"bounds are checked" if vars(config).get("BOUNDSCHECK") else b"")
    below = {file for each in (*floors[: own + 1], folder) for file in each.rglob("*.py")}
    for file in sorted({Path(__file__), *below}):
        digest.update(str(file.relative_to(_PACKAGE) if file.is_relative_to(_PACKAGE) else file).encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _cached(function: F, dispatcher: Any) -> F:
    try:
        dispatcher._cache = _StampedCache(function)
    except RuntimeError:  # Numba finds no folder that it may write: neither the package's nor the user's
        dispatcher._cache = NullCache()
    return dispatcher


class _StampedCache(FunctionCache):
    """Numba's cache of one function, under the stamp of all its sources."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        stamp, file = source_stamp(Path(inspect.getfile(function)).parent), self._cache_file
        file._source_stamp = (file._source_stamp, stamp)
        self._base = file._data_name_pattern.removesuffix("{number:d}.nbc")
        self._own = f"{self._base}{stamp[:16]}."
        file._data_name_pattern = self._own + "{number:d}.nbc"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function, or None if there is none, or only a damaged one, which is compiled and saved anew."""
        try:
            return super().load_overload(sig, target_context)
        except _DAMAGE:
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save the compiled function. A full or read-only disk is said once; the function works all the same."""
        try:
            super().save_overload(sig, data)
            self._sweep()
        except _DAMAGE:
            self._replace(sig, data)

    def _sweep(self) -> None:
        """Delete this function's machine code of other sources; a process that still runs them compiles anew."""
        for file in Path(self._cache_file._cache_path).glob("*.nbc"):
            if file.name.startswith(self._base) and not file.name.startswith(self._own):
                file.unlink(missing_ok=True)

    def _replace(self, sig: Any, data: Any) -> None:
        try:
            self.flush()
            super().save_overload(sig, data)
        except _DAMAGE as error:
            self.disable()
            _say_once(f"{type(error).__name__}: {error}")


@lru_cache
def _say_once(reason: str) -> None:
    warnings.warn(
        f"compiled kernels cannot be cached ({reason}); they are compiled anew in every process. "
        "Set NUMBA_CACHE_DIR to a folder that can be written.",
        stacklevel=2,
    )
