"""The list of physics checks: quantity, expected, source, ours. `magwire validate` prints it at full size.

One list, two sizes: `run(CHECKS, FULL)` for the record, `run(CHECKS, TEST)` in the test suite.
"""

from __future__ import annotations

from . import claims, inverse, magnets, motion, rods
from .free import base as free_base
from .free import contact as free_contact
from .free import locked as free_locked
from .free import rods as free_rods
from .free import tubes as free_tubes
from .free import twist as free_twist
from .report import FULL, TEST, Check, Row, Size, run, table

__all__ = ["CHECKS", "FULL", "TEST", "Check", "Row", "Size", "run", "table"]

CHECKS = (
    Check("printed constants", magnets.printed_constants),
    Check("block and tip, coaxial", magnets.coaxial),
    Check("block against magpylib", magnets.exact_block, needs="magpylib"),
    Check("simulator's tip force against magpylib", magnets.along_the_tract, needs="magpylib"),
    Check("conservation laws of dipoles", magnets.conservation),
    Check("cantilever", lambda size: rods.elastica_rows(size.segments)),
    Check("tip dipole in a uniform field", lambda size: rods.end_couple_rows(size.segments)),
    Check("buckling", lambda size: rods.buckling(size.segments // 5)),
    Check("order of the free rod", lambda size: rods.order_in_segments(size.segments)),
    Check("springs in series", lambda size: rods.series_springs(size.segments)),
    Check("snap of the free rod", lambda _: rods.axial_snap(12)),
    Check("cantilever against PyElastica", lambda size: rods.cosserat(size.segments), needs="elastica"),
    Check("random loads on the free rod", rods.random_loads),
    Check("from shapes back to fields", inverse.inverse),
    Check("friction on a straight tract", motion.friction),
    Check("capstan", motion.capstan),
    Check("release force", motion.release_force),
    Check("creep out of a bend", motion.creep_out),
    Check("generalised force", motion.generalised_force),
    Check("closed tract", motion.closed_tract),
    Check("energy", motion.energy),
    Check("convergence in step and mesh", motion.convergence),
    Check("the paper's claim", claims.claim),
    Check("its limits", claims.limits),
    Check("the coupling", claims.coupling),
    Check("F1 rods at rest", free_rods.at_rest),
    Check("F1 buckling", free_rods.buckling),
    Check("F2 no clearance", free_locked.without_clearance),
    Check("F3 free flight", free_rods.flight),
    Check("F4 static shape", free_rods.static_shape),
    Check("F5 pendulum", free_rods.pendulum),
    Check("F6 Greenhill", free_twist.greenhill),
    Check("F7 Michell's ring", free_twist.ring),
    Check("F8 localised buckling", free_twist.localised),
    Check("F9 45° bend", free_rods.bend),
    Check("F10 clamped helices", free_twist.helices),
    Check("F11 heavy loop", free_rods.loop),
    Check("F12 capstan of a string", free_contact.capstan_of_a_string),
    Check("F13 capstan of a rod", free_contact.capstan_of_a_rod),
    Check("F14 point to line contact", free_contact.point_to_line),
    Check("F15 floor of a tube", free_tubes.floor),
    Check("F16 helix in a tube", free_tubes.helix_in_a_tube),
    Check("F17 lock-up", free_tubes.lock_up),
    Check("F18 sleeve", free_base.sleeve),
    Check("F19 whip", free_base.whip),
    Check("F20 turning while pushing", free_contact.turning_while_pushing),
    Check("F21 sliding", free_contact.sliding),
    Check("F22 contact load", free_contact.contact_load),
)
