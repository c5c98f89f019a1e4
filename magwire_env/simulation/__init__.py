"""Scenarios in motion: the simulator and the wire models behind it."""

from importlib import import_module
from typing import Any

from .library import Library
from .model import Places, register_model
from .simulator import Simulator
from .state import SimulatorState, Trajectories

__all__ = ["Library", "Places", "Simulator", "SimulatorState", "Trajectories", "register_model"]

_THEORY = ("best_command", "best_placement", "certificate", "certify", "drive_at", "force_map", "Certificate")
"""Names that users may import from here too; they live one floor up, in `magwire_env.quasistatic`."""


def __getattr__(name: str) -> Any:
    if name in _THEORY:
        return getattr(import_module("magwire_env.quasistatic"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
