"""The parts and their laws: magnets as dipole clouds, the tract, the wire. Pure; knows no Gymnasium."""

from .dipoles import MU0, DipoleCloud, field, field_gradient, force, torque
from .guidewire import Guidewire
from .magnets import BlockMagnet, CylinderMagnet, Magnet, PointDipole
from .rod import FreeRod, NotConverged, RodPath
from .tract import Tract

__all__ = [
    "MU0",
    "BlockMagnet",
    "CylinderMagnet",
    "DipoleCloud",
    "FreeRod",
    "Guidewire",
    "Magnet",
    "NotConverged",
    "PointDipole",
    "RodPath",
    "Tract",
    "field",
    "field_gradient",
    "force",
    "torque",
]
