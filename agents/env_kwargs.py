"""Keyword arguments of an env as a command takes them: ``--env-kwargs action_mode=rate time_limit=45``."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["ENV_KEYS", "OWN", "parsed", "world"]

ENV_KEYS = ("coupling", "action_mode", "observe", "reward", "time_limit", "safety", "split", "pool_size")
"""Arguments of an env that a file may set. A scenario stands in the file itself, and is never a path."""

OWN = ("observe", "action_mode", "reward")
"""Arguments that are a policy's own business: other policies play the same episodes without them."""


def parsed(pairs: Sequence[str]) -> dict[str, Any]:
    """``key=value`` pairs as keyword arguments of an env.

    A value is a TOML value or else a word; words with commas between them are a list.

    >>> parsed(["observe=tip_speed,magnet", "time_limit=45", "safety=true", "reward={success=20}"])
    {'observe': ['tip_speed', 'magnet'], 'time_limit': 45, 'safety': True, 'reward': {'success': 20}}
    >>> parsed(['observe=["base", {lao = 30, noise = 0.02}]'])  # an image, with options
    {'observe': ['base', {'lao': 30, 'noise': 0.02}]}

    Raises `ValueError` for something else than a pair, and for a key that no env takes.
    """
    found: dict[str, Any] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        known = (*ENV_KEYS, "scenario")
        if not equals or key not in known:
            raise ValueError(f"env-kwargs must be key=value with a key of {', '.join(known)}; got {pair!r}")
        if key in found:
            raise ValueError(f"env-kwargs must name each key once, got {key!r} twice")
        found[key] = _value(value)
    if isinstance(found.get("observe"), str):
        found["observe"] = [found["observe"]]
    return found


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.split(",") if "," in text else text


def world(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Of an env's keyword arguments those that make its episodes what they are, for policies that play them too."""
    return {key: value for key, value in settings.items() if key not in OWN}
