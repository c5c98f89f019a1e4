"""What a run needs, as frozen values: the scenario and its parts, and their TOML form."""

from .base import Feed, Twist
from .rig import ActuatedMagnet, Coil, Current, Rig, Slide, Turn
from .scenario import COUPLINGS, Contact, Scenario, Timing, above
from .sensing import Reading, Sensing, Variation

__all__ = [
    "COUPLINGS",
    "ActuatedMagnet",
    "Coil",
    "Contact",
    "Current",
    "Feed",
    "Reading",
    "Rig",
    "Scenario",
    "Sensing",
    "Slide",
    "Timing",
    "Turn",
    "Twist",
    "Variation",
    "above",
]
