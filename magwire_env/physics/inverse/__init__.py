"""From a wanted shape of the free rod back to the field that makes it; see `FreeRod.field_for` and `FreeRod.rig_for`.

Three parts: what is wanted (`targets`), what may be set (`means`), and the search (`search`), which follows the rod's
equilibrium by its implicit derivative (`response`).
"""

from .search import solve
from .solution import ShapeSolution
from .targets import Curve, TipPose

__all__ = ["Curve", "ShapeSolution", "TipPose", "solve"]
