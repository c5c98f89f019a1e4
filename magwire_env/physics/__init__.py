"""The parts and their laws: magnets as dipole clouds, the wire, the free rod. Pure; knows no files and no Gymnasium."""

from importlib import import_module
from typing import Any

from .dipoles import MU0, DipoleCloud, field, field_gradient, force, torque
from .guidewire import Guidewire
from .inverse import Curve, ShapeSolution, TipPose
from .magnets import BlockMagnet, CylinderMagnet, Magnet, PointDipole
from .rod import FreeRod, NotConverged, RodPath

__all__ = [
    "MU0",
    "BlockMagnet",
    "Curve",
    "CylinderMagnet",
    "DipoleCloud",
    "FreeRod",
    "Guidewire",
    "Magnet",
    "NotConverged",
    "PointDipole",
    "RodPath",
    "ShapeSolution",
    "TipPose",
    "field",
    "field_gradient",
    "force",
    "torque",
]


def __getattr__(name: str) -> Any:
    if name == "Tract":  # users may import it from here too; it lives one floor up
        return import_module("magwire_env.lumen").Tract
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
