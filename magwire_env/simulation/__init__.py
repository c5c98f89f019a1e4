"""Scenarios in motion: the batched kernel, the simulator, force maps and best commands."""

from .forcemap import best_command, drive_at, force_map
from .simulator import Simulator, SimulatorState, Trajectories

__all__ = ["Simulator", "SimulatorState", "Trajectories", "best_command", "drive_at", "force_map"]
