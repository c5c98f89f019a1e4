"""Words that go with numbers."""

from __future__ import annotations

__all__ = ["counted"]


def counted(number: int, noun: str, plural: str = "") -> str:
    """A number and what is counted, in the singular where there is one of it.

    plural : of the noun; by default the noun with an s

    >>> counted(1, "episode"), counted(0, "episode"), counted(2, "branch", "branches")
    ('1 episode', '0 episodes', '2 branches')
    """
    return f"{number} {noun if number == 1 else plural or noun + 's'}"
