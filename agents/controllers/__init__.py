"""Classical controllers: each answers SB3's ``predict``, single or batched, so one evaluator serves all policies."""

from .base import Controller
from .constant_rotation import ConstantRotation
from .max_force import MaxForce
from .net_force import NetForce
from .random import Random

CONTROLLERS: dict[str, type[Controller]] = {c.__name__: c for c in (MaxForce, NetForce, ConstantRotation, Random)}

__all__ = ["CONTROLLERS", "ConstantRotation", "Controller", "MaxForce", "NetForce", "Random"]
