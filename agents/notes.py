"""What a command says beside its result, on the error stream."""

from __future__ import annotations

import sys

__all__ = ["note"]

_said: set[str] = set()


def note(text: str) -> None:
    """Say `text`, once a process."""
    if text not in _said:
        _said.add(text)
        print(f"note: {text}", file=sys.stderr, flush=True)
