"""Classical controllers: each answers SB3's ``predict``, single or batched, so one evaluator serves all policies."""

from .base import Controller
from .constant_rotation import ConstantRotation
from .extremum_seeking import ExtremumSeeking
from .max_force import MaxForce
from .mppi import MPPI, MPPISettings
from .net_force import NetForce
from .optimal import Optimal
from .pd import PD
from .random import Random

CONTROLLERS: dict[str, type[Controller]] = {
    c.__name__: c for c in (MaxForce, NetForce, ExtremumSeeking, PD, MPPI, Optimal, ConstantRotation, Random)
}

__all__ = [
    "CONTROLLERS", "MPPI", "PD", "ConstantRotation", "Controller", "ExtremumSeeking", "MPPISettings", "MaxForce",
    "NetForce", "Optimal", "Random",
]  # fmt: skip
