"""Classical controllers: each answers SB3's ``predict``, single or batched, so that one evaluator serves all policies.

`agents.catalogue` lists them by name, together with the par (`agents.par.optimal`) and those that users register.
"""

from .base import Controller
from .constant_rotation import ConstantRotation
from .extremum_seeking import ExtremumSeeking
from .follow_route import FollowRoute, Forward, Hold, RecoverRoute
from .inverse_shape import InverseShape
from .max_force import MaxForce
from .mppi import MPPI, MPPISettings
from .net_force import NetForce
from .pd import PD
from .random import Random
from .slope_ascent import SlopeAscent

__all__ = [
    "MPPI", "PD", "ConstantRotation", "Controller", "ExtremumSeeking", "FollowRoute", "Forward", "Hold", "InverseShape",
    "MPPISettings", "MaxForce", "NetForce", "Random", "RecoverRoute",
    "SlopeAscent",
]  # fmt: skip
