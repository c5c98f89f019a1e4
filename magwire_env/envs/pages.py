"""One class a task, for its page: what it asks and how it differs from `MagWireEnv`, which does all the work."""

from __future__ import annotations

from typing import Any

from .env import MagWireEnv

__all__ = ["PAGES", "Chase", "Dual", "Orient", "Reach", "Steer", "SteerAny", "Track"]


class Steer(MagWireEnv):
    __doc__ = MagWireEnv.__doc__

    def __init__(self, task: str = "MagWire/Steer-v0", render_mode: str | None = None, **settings: Any) -> None:
        super().__init__(task, render_mode, **settings)


class Reach(MagWireEnv):
    """Bring the tip to a random target, either way along the paper's tract, and hold it there.

    ## Description
    The paper's set-up (one magnet, one axis, coupling "force"). The target lies 50 mm or more ahead of the tip or
    behind it; the wire is then pushed back by its tip.

    ## Observation Space
    As `MagWire/Steer-v0`'s; number 6, the way left / tract length, is negative for a target behind the tip.

    ## Action Space
    As `MagWire/Steer-v0`'s.

    ## Dynamics
    As `MagWire/Steer-v0`'s.

    ## Reward
    As `MagWire/Steer-v0`'s, with progress counted by the distance to the target, on either side of it.

    ## Starting State
    Tip uniform between the wire's length and 10 mm before the tract's end, target likewise but at least 50 mm away,
    magnet angle uniform, at rest. `options` as `MagWire/Steer-v0`'s; `target` may lie on either side.

    ## Episode End
    Terminated when the tip has stayed within 5 mm of the target for 1 s (`is_success`), or leaves the tract backwards.
    Truncated after 30 s. `summary["time"]` runs to the end of the holding.

    ## Arguments
    As `MagWireEnv`'s. `MagWire/ReachGoal-v0` is the same task as a goal env.

    ## Version History
    * v0: first
    """

    def __init__(self, task: str = "MagWire/Reach-v0", render_mode: str | None = None, **settings: Any) -> None:
        super().__init__(task, render_mode, **settings)


class Track(MagWireEnv):
    """Follow a moving reference along the paper's tract, both ways.

    ## Description
    The paper's set-up. The reference s(t) is a sum of three slow sines about a middle, drawn anew for every episode,
    at most 30 mm/s fast and always inside the tract.

    ## Observation Space
    `MagWire/Steer-v0`'s seven numbers, then the reference now and in 0.5, 1 and 2 s, from the tip / 0.1 m, each within
    ±10. Number 6, the way left, is to the reference now.

    ## Action Space
    As `MagWire/Steer-v0`'s.

    ## Dynamics
    As `MagWire/Steer-v0`'s.

    ## Reward
    ``reward/progress`` 10 for every 5 mm by which the error shrinks, ``reward/time`` −0.1 a step for every 5 mm of
    error, ``reward/success`` 10 at the end if the RMS error is at most 5 mm, ``reward/wall`` as `MagWire/Steer-v0`'s.

    ## Starting State
    Tip on the reference, magnet angle uniform, at rest. `options` takes `magnet_angle` alone.

    ## Episode End
    Truncated after 30 s (`is_success` if the RMS error is at most 5 mm); terminated when the tip leaves the tract
    backwards. `summary["rms_error"]` in m; `path_ratio` is 1 − error/5 mm.

    ## Arguments
    As `MagWireEnv`'s.

    ## Version History
    * v0: first
    """

    def __init__(self, task: str = "MagWire/Track-v0", render_mode: str | None = None, **settings: Any) -> None:
        super().__init__(task, render_mode, **settings)


_GENERATED = """
    ## Observation Space
    `MagWire/Steer-v0`'s channels, with every turn's sine and cosine and every slide's place in its range, then the
    `tract_preview`: the centreline 0, 10, 20, 40, 60 and 80 mm ahead of the tip, as points from the first magnet's
    centre / 0.1 m (18 numbers within ±10) and tangents (18 within ±1).

    ## Dynamics
    As `MagWire/Steer-v0`'s, under the scenario's own coupling.

    ## Reward
    As `MagWire/Steer-v0`'s.

    ## Starting State
    A certified scenario of the pool, tip at the wire's length ± 20 mm, the rig anywhere in its range, at rest.
    Which scenario it is depends on the seed and the episode's number alone.

    ## Episode End
    As `MagWire/Steer-v0`'s, but truncated after 60 s.

    ## Arguments
    As `MagWireEnv`'s; `split="train"`, "test" or "ood" and `pool_size=` choose the pool, see
    `magwire_env.quasistatic.pool` for what its tracts, wires and rigs are.

    ## Version History
    * v0: first
    """


class SteerAny(MagWireEnv):
    __doc__ = (
        """Steer along a tract never seen before, with the paper's fixed one-axis magnet and coupling.

    ## Description
    Every episode has another generated tract, of which the certificate says that it can be steered.

    ## Action Space
    As `MagWire/Steer-v0`'s.
"""
        + _GENERATED
    )

    def __init__(self, task: str = "MagWire/SteerAny-v0", render_mode: str | None = None, **settings: Any) -> None:
        super().__init__(task, render_mode, **settings)


class Orient(MagWireEnv):
    __doc__ = (
        """Steer with a fixed magnet that turns to any direction, under the energy-consistent coupling.

    ## Description
    The magnet turns about y and then about z, so its moment may point anywhere; the tip feels force and torque.

    ## Action Space
    `Box(-1, 1, (2,), float32)`: the two angles, ±1 ↔ home ± π rad each.
"""
        + _GENERATED
    )

    def __init__(self, task: str = "MagWire/Orient-v0", render_mode: str | None = None, **settings: Any) -> None:
        super().__init__(task, render_mode, **settings)


class Chase(MagWireEnv):
    __doc__ = (
        """Steer with a magnet that follows the tip: it slides in x and y above the tract and turns about y.

    ## Description
    The rig of a robot arm over a patient, under the energy-consistent coupling.

    ## Action Space
    `Box(-1, 1, (3,), float32)`: the angle, ±1 ↔ home ± π rad, and the places in x and y, ±1 ↔ the slides' limits. The
    servos are limited in speed.
"""
        + _GENERATED
    )

    def __init__(self, task: str = "MagWire/Chase-v0", render_mode: str | None = None, **settings: Any) -> None:
        super().__init__(task, render_mode, **settings)


class Dual(MagWireEnv):
    __doc__ = (
        """Steer with two fixed magnets, one axis each, under the energy-consistent coupling.

    ## Description
    One magnet above the tract turns about y, one below about x; their fields add.

    ## Action Space
    `Box(-1, 1, (2,), float32)`: the two angles, ±1 ↔ home ± π rad each.
"""
        + _GENERATED
    )

    def __init__(self, task: str = "MagWire/Dual-v0", render_mode: str | None = None, **settings: Any) -> None:
        super().__init__(task, render_mode, **settings)


PAGES = {f"MagWire/{page.__name__}-v0": page for page in (Steer, Reach, Track, SteerAny, Orient, Chase, Dual)}
