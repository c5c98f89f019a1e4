"""Refusing bad input: every error names the parameter, its value and what is allowed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

__all__ = ["finite", "in_range", "non_negative", "one_of", "points_array", "positive", "vector", "whole"]


def finite(name: str, value: Any, unit: str = "") -> float:
    """Return `value` as a finite float or raise `ValueError` naming it."""
    try:
        if isinstance(value, (str, bytes, bool)):  # float() would take "5" for 5 and True for 1
            raise TypeError
        number = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a number{_in(unit)}, got {value!r}") from None
    except OverflowError:  # a whole number beyond all floats
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite{_in(unit)}, got {_short(value)}")
    return number


def positive(name: str, value: Any, unit: str = "") -> float:
    """Return `value` as a float > 0 or raise `ValueError` naming it."""
    number = finite(name, value, unit)
    if number <= 0:
        raise ValueError(f"{name} must be greater than 0{_in(unit)}, got {value!r}")
    return number


def non_negative(name: str, value: Any, unit: str = "") -> float:
    """Return `value` as a float >= 0 or raise `ValueError` naming it."""
    number = finite(name, value, unit)
    if number < 0:
        raise ValueError(f"{name} must be at least 0{_in(unit)}, got {value!r}")
    return number


def in_range(name: str, value: Any, low: float, high: float, unit: str = "") -> float:
    """Return `value` as a float in [low, high] or raise `ValueError` naming it."""
    number = finite(name, value, unit)
    if not low <= number <= high:
        raise ValueError(f"{name} must lie in [{low:g}, {high:g}]{_in(unit)}, got {value!r}")
    return number


def whole(name: str, value: Any, least: int) -> int:
    """Return `value` as an int >= `least` or raise `ValueError` naming it."""
    try:
        number = int(value)
        if isinstance(value, (str, bytes, bool)) or number != value or number < least:
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be a whole number of at least {least}, got {value!r}") from None
    return number


def one_of(name: str, value: Any, allowed: Sequence[str]) -> str:
    """Return `value` if it is one of `allowed` or raise `ValueError` listing them."""
    if value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, allowed))}, got {value!r}")
    return value


def vector(name: str, value: Any, length: int = 3, unit: str = "") -> tuple[float, ...]:
    """Return `value` as a tuple of `length` finite floats or raise `ValueError` naming it."""
    try:
        if isinstance(value, (str, bytes)):
            raise TypeError
        items = tuple(float(x) for x in value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be {length} numbers{_in(unit)}, got {_short(value)}") from None
    if len(items) != length or not all(map(math.isfinite, items)):
        raise ValueError(f"{name} must be {length} finite numbers{_in(unit)}, got {value!r}")
    return items


def points_array(name: str, value: Any, unit: str = "") -> np.ndarray:
    """Return `value` as a finite float64 array of shape (n, 3) or raise `ValueError` naming it."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be an (n, 3) array{_in(unit)}, got {type(value).__name__}") from None
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name} must have shape (n, 3){_in(unit)}, got shape {array.shape}")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if bad.size:
        raise ValueError(f"{name}[{bad[0]}] must be finite{_in(unit)}, got {array[bad[0]].tolist()}")
    return array


def _short(value: Any) -> str:
    """`value` for a message, cut where it is long; Python refuses to write out a whole number of 4300 digits."""
    try:
        text = repr(value)
    except ValueError:
        return "a number of thousands of digits"
    return text if len(text) <= 200 else f"{text[:197]}…"


def _in(unit: str) -> str:
    return f" (in {unit})" if unit else ""
