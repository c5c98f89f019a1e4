"""The rig as arrays: of the scenarios of a batch, and of the lanes that run them. Shared by all wire models."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..physics.dipoles import MU0
from ..physics.magnets import PointDipole
from ..scenario import Feed, Scenario, Turn, Twist
from .lanes import LANES
from .magnetics import MAGNET, SLOT, SOURCE, Magnetics
from .servo import Actuators

__all__ = ["RigLanes", "RigLibrary", "aligned_zeros"]


class RigLibrary:
    """The rigs of a batch's scenarios, one row an entry.

    dof, magnet_count : degrees of freedom; magnets, coils not counted
    is_turn : (dof,)
    feed, twist : which degree of freedom feeds and turns a wire's base, −1 for none; they come last
    home : (entries, dof) rad, m or A
    limits : (entries, dof, 3), see `magwire_env.simulation.servo.Limit`
    slots : (magnets and coils, 9), see `magwire_env.simulation.magnetics.Slot`
    magnets : (entries, magnets and coils, 5), see `magwire_env.simulation.magnetics.Magnet`

    Raises `ValueError` if the scenarios differ in the kinds of their degrees of freedom.
    """

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        layout = scenarios[0].rig.layout
        for i, sc in enumerate(scenarios):
            if sc.rig.layout != layout:
                raise ValueError(
                    f"scenario[{i}].rig must have the batch's degrees of freedom {layout}, got {sc.rig.layout}"
                )
        rig = scenarios[0].rig
        self.dof, self.magnet_count = len(rig.dofs), len(rig.magnets)
        self.is_turn = np.array([isinstance(d, Turn) for d in rig.dofs], dtype=np.bool_)
        kinds = [type(d) for d in rig.dofs]
        self.feed, self.twist = (kinds.index(k) if k in kinds else -1 for k in (Feed, Twist))
        self.home = np.array([[d.home for d in sc.rig.dofs] for sc in scenarios], dtype=np.float64).reshape(
            -1, self.dof
        )
        self.limits = np.array([sc.rig.limits for sc in scenarios]).reshape(-1, self.dof, 3)
        self.slots = _slots(scenarios[0])
        self.magnets = np.array([_magnet_rows(sc) for sc in scenarios])
        self._collect_clouds(scenarios)

    def _collect_clouds(self, scenarios: Sequence[Scenario]) -> None:
        """The different clouds, each once, and which magnet of which scenario has which."""
        kinds: dict[tuple, int] = {}
        none = (PointDipole(1.0), ("gauss", 1))  # what stands in a coil's place, and is not summed
        mounts = [[(m.magnet, m.dipoles) for m in sc.rig.magnets] + [none] * len(sc.rig.coils) for sc in scenarios]
        self.cloud_of = np.array([[kinds.setdefault(mount, len(kinds)) for mount in row] for row in mounts])
        clouds = []
        for magnet, rule in kinds:
            cloud = magnet.dipoles(*rule)
            clouds.append(np.column_stack([cloud.positions, cloud.moments[:, 2] / magnet.moment]))
        counts = np.array([len(c) for c in clouds])
        self.sources = counts[self.cloud_of].max(axis=0)
        self.clouds = np.zeros((len(clouds), counts.max(), len(SOURCE)))
        for padded, cloud in zip(self.clouds, clouds, strict=True):
            padded[: len(cloud)] = cloud


class RigLanes:
    """The rigs of a batch's lanes: their parameters, where they are, and what they are told.

    entry : (n,), which of the scenarios is a lane's
    q, command : (dof, lanes) rad, m or A; lanes is `num_envs` rounded up to whole blocks, and one block more, lest
        rows lie powers of two apart in memory
    limits : (dof, 3, lanes)
    """

    def __init__(self, library: RigLibrary, n: int) -> None:
        self.library, self.n = library, n
        self.entry = np.zeros(n, dtype=np.int64)
        blocks, count = -(-n // LANES), len(library.slots)
        self.lanes = (blocks + 1) * LANES
        self.q, self.command = aligned_zeros(library.dof, self.lanes), aligned_zeros(library.dof, self.lanes)
        self.limits = np.ones((library.dof, 3, self.lanes))
        self.limits[:, 1] = -1.0
        self._magnets = aligned_zeros(blocks, count, len(MAGNET), LANES)
        self._lane_cloud = np.zeros((blocks, LANES, count), dtype=np.int64)
        self._tables: dict[bytes, int] = {}
        self._clouds = aligned_zeros(0, library.clouds.shape[1], len(SOURCE), LANES)
        self._cloud_of = np.zeros((blocks, count), dtype=np.int64)
        self._actuators = tuple(Actuators(self.limits, library.is_turn, self.q, self.command))
        self._collect_magnetics()

    def _collect_magnetics(self) -> None:
        library = self.library
        found = Magnetics(library.slots, self._magnets, self._clouds, self._cloud_of, library.sources)
        self._magnetics = tuple(found)

    def place(self, lanes: np.ndarray, magnet: np.ndarray) -> None:
        """Put what is outside the wire to (n, dof) rad, m or A; where a wire's base is, the wire itself says."""
        base = (self.library.feed >= 0) + (self.library.twist >= 0)
        self.q[: self.library.dof - base, lanes] = magnet.T[: self.library.dof - base]

    @property
    def magnetics(self) -> tuple:
        """The fields of `Magnetics`."""
        return self._magnetics

    @property
    def actuators(self) -> tuple:
        """The fields of `Actuators`."""
        return self._actuators

    def take(self, lanes: np.ndarray, entries: np.ndarray) -> None:
        """Give `lanes` the rigs of the library's `entries`."""
        block, lane = np.divmod(lanes, LANES)
        library = self.library
        self.entry[lanes] = entries
        self._magnets[block, :, :, lane] = library.magnets[entries]
        self.limits[:, :, lanes] = library.limits[entries].transpose(1, 2, 0)
        if (self._lane_cloud[block, lane] != library.cloud_of[entries]).any() or not len(self._clouds):
            self._lane_cloud[block, lane] = library.cloud_of[entries]
            self._stack_clouds(np.unique(block))

    def vary(self, lanes: np.ndarray, remanence: np.ndarray, placement: np.ndarray) -> None:
        """Scale the magnets' strengths by factors (n,), and shift their centres by (n, magnets, 3) m."""
        block, lane = np.divmod(lanes, LANES)
        count = self.library.magnet_count
        self._magnets[block, :count, MAGNET.strength, lane] *= remanence[:, None]
        for axis in range(3):
            self._magnets[block, :count, MAGNET.centre_x + axis, lane] += placement[:, :, axis]

    def idle(self, first: int) -> None:
        """Give the last block's lanes from `first` on what its first lane has: they run, and nobody reads them."""
        spare = -first % LANES
        if spare:
            self._magnets[-1, ..., -spare:] = self._magnets[-1, ..., :1]
            self._lane_cloud[-1, -spare:] = self._lane_cloud[-1, 0]
            start = first + spare - LANES
            self.limits[:, :, first : first + spare] = self.limits[:, :, start : start + 1]
            self._stack_clouds(np.array([len(self._magnets) - 1]))

    def centres(self) -> np.ndarray:
        """Where the magnets are by their nominal positions and their slides, without what `vary` shifted: (n, m, 3) m.

        A policy, a controller and a picture know the rig as it was set up.
        """
        count = self.library.magnet_count
        centres = self.library.magnets[self.entry, :count, :3].copy()
        for m, slots in enumerate(self.library.slots[:count]):
            for axis in range(3):
                if slots[SLOT.slide_x + axis] >= 0:
                    centres[:, m, axis] += self.q[slots[SLOT.slide_x + axis], : self.n]
        return centres

    def _stack_clouds(self, blocks: np.ndarray) -> None:
        """Blocks whose lanes have the same clouds share one table of sources, lane by lane.

        Tables that no block uses any more are dropped once there are twice as many as blocks could use.
        """
        for block in blocks:
            for m in range(self._cloud_of.shape[1]):
                mix = self._lane_cloud[block, :, m]
                number = self._tables.setdefault(mix.tobytes(), len(self._tables))
                if number == len(self._clouds):
                    stacked = self.library.clouds[mix].transpose(1, 2, 0)
                    clouds = aligned_zeros(number + 1, *stacked.shape)
                    clouds[:number], clouds[number] = self._clouds, stacked
                    self._clouds = clouds
                self._cloud_of[block, m] = number
        if len(self._clouds) > 2 * self._cloud_of.size + 2:
            self._drop_unused_tables()
        self._collect_magnetics()

    def _drop_unused_tables(self) -> None:
        used = np.unique(self._cloud_of)
        kept = aligned_zeros(len(used), *self._clouds.shape[1:])
        kept[:] = self._clouds[used]
        number = {int(old): new for new, old in enumerate(used)}
        self._clouds, self._cloud_of = kept, np.searchsorted(used, self._cloud_of)
        self._tables = {mix: number[old] for mix, old in self._tables.items() if old in number}


def aligned_zeros(*shape: int) -> np.ndarray:
    """Zeros that start on a cache line, which no vector of 64 bytes then straddles."""
    flat = np.zeros(int(np.prod(shape)) + 8)
    first = -(flat.ctypes.data // 8) % 8
    return flat[first : first + int(np.prod(shape))].reshape(shape)


def _slots(scenario: Scenario) -> np.ndarray:
    """Which command entry moves which slot of which magnet or coil."""
    rig = scenario.rig
    slots = np.full((len(rig.magnets) + len(rig.coils), len(SLOT)), -1, dtype=np.int64)
    number = 0
    for m, mount in enumerate(rig.magnets):
        turns = 0
        for dof in mount.dofs:
            if isinstance(dof, Turn):
                slots[m, SLOT.turn_1 + turns], slots[m, SLOT.axis_1 + turns] = number, "xyz".index(dof.axis)
                turns += 1
            else:
                slots[m, SLOT.slide_x + "xyz".index(dof.axis)] = number
            number += 1
    for c, coil in enumerate(rig.coils, start=len(rig.magnets)):
        slots[c, SLOT.current], slots[c, SLOT.coil_axis] = number, "xyz".index(coil.axis)
        number += 1
    return slots


def _magnet_rows(sc: Scenario) -> list[tuple[float, ...]]:
    """Centre, strength and gradient of every magnet, then of every coil."""
    magnets: list[tuple[float, ...]] = [(*m.position, MU0 / (4 * np.pi) * m.magnet.moment, 0.0) for m in sc.rig.magnets]
    return magnets + [(*c.position, c.uniform, c.gradient) for c in sc.rig.coils]
