"""Whether a trial of the search becomes the iterate, and what is tried next; see `stepper`."""

from __future__ import annotations

from ...compiled import inlined
from ..lanes import absolute, load, maximum, minimum, store, where
from . import layout as at

ARMIJO = 1e-4
NOISE, LEAST_MOVE = 1e-13, 1e-9
"""What rounding may raise the potential by: this share of it, and the force tolerance times this way (m)."""

HIDDEN, NEARER = 1e-11, 0.25
"""Share of the potential that rounding may hide, and what must be left of the Newton decrement where it does."""

PLAIN, HELD_ON, FORESEEN, WITHOUT = 0.0, 1.0, 2.0, 3.0
"""Which direction is wanted of an evaluation. Of a trial: by its own contacts, or by those of the evaluation before,
too. Of the iterate once more, after a trial was refused: by the trial's contacts, too, or by its own."""

MOST_REBUILT = 3.0
"""How often the direction from one iterate is sought anew with the contacts that trials have shown."""

HUGE = 1e300
REFUSED = 1e3
"""J, an energy that even a step's first trial may not have: a point is far outside the wall."""


@inlined
def judge(old, new, worst, decrement, fresh, par, lane, running):
    """Whether the trial is taken, whether it balances the forces, and whether it was the iterate once more."""
    alpha, slope, tries = load(lane, at.ALPHA), load(lane, at.SLOPE), load(lane, at.TRIES)
    energy = load(lane, at.ENERGY)
    noise = NOISE * (absolute(old) + absolute(energy)) + LEAST_MOVE * load(par, at.FORCE_TOLERANCE)
    hidden = HIDDEN * (absolute(old) + absolute(energy))
    balances = (old <= energy + hidden) & (decrement <= -NEARER * slope)
    falls = old <= energy + ARMIJO * alpha * slope + noise
    anew = running & (load(lane, at.FORESEES) > 1.5)
    tried = running & (load(lane, at.FORESEES) < 1.5)
    taken = tried & (falls | balances | ((tries < 0.5) & (old < REFUSED)))
    rejected = tried & (old > -HUGE)
    rebuilt = load(lane, at.REBUILT)
    unforeseen = where(taken, 0.0, where(tried & (fresh > 0.0) & (rebuilt < MOST_REBUILT), 1.0, 0.0)) > 0.5
    store(lane, at.REBUILT, where(taken, 0.0, where(anew, rebuilt + 1.0, rebuilt)))
    store(lane, at.FORESEES, where(unforeseen, FORESEEN, where(taken, HELD_ON, PLAIN)))
    # along the parabola through both ends
    drop = maximum(old - energy - alpha * slope, 1e-300)
    shorter = minimum(maximum(-0.5 * slope * alpha * alpha / drop, 0.1 * alpha), 0.5 * alpha)
    store(lane, at.ALPHA, where(taken, 1.0, where(unforeseen, 0.0, where(rejected, shorter, 0.1 * alpha))))
    store(lane, at.ENERGY, where(taken, new, energy))
    exact = load(lane, at.EXACT)
    kept = anew | (unforeseen & (rebuilt < 0.5))
    store(lane, at.EXACT, where(taken, where(alpha >= 1.0, 1.0, exact), where(kept, exact, where(running, 0.0, 1.0))))
    store(lane, at.TRIES, where(running, tries + 1.0, tries))
    store(lane, at.TAKEN, where(taken | anew, 1.0, 0.0))
    store(lane, at.EVALUATED, load(lane, at.EVALUATED) + where(running, 1.0, 0.0))
    return taken, taken & (worst <= load(par, at.FORCE_TOLERANCE)), anew
