"""Scenarios in motion: the batched kernel, the simulator, force maps, best commands, certificates and placement."""

from .certificate import Certificate, certificate, certify
from .forcemap import best_command, drive_at, force_map
from .placement import best_placement
from .simulator import Simulator, SimulatorState, Trajectories

__all__ = [
    "Certificate",
    "Simulator",
    "SimulatorState",
    "Trajectories",
    "best_command",
    "best_placement",
    "certificate",
    "certify",
    "drive_at",
    "force_map",
]
