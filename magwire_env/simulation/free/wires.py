"""Free wires as arrays: packing them for the kernels, and moving them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..lanes import LANES
from ..threads import cores, share_out
from . import layout as at
from . import magnetics, stepper
from .bricks import Bricks
from .pieces import Pieces
from .tubes import Tube

__all__ = ["FreeWires", "Pieces"]


def _zeros(rows: int, columns: int) -> np.ndarray:
    """Zeros that start on a cache line."""
    flat = np.zeros(rows * columns + 8)
    first = -(flat.ctypes.data // 8) % 8
    return flat[first : first + rows * columns].reshape(rows, columns)


NO_WALL = np.zeros((1, at.TABLE_STRIDE))
NO_WALL[0, 1], NO_WALL[0, 12], NO_WALL[0, 16:18] = 1.0, 1e9, (-1e9, 1e9)


NO_MARKS = np.zeros(0)


class FreeWires:
    """A batch of n free wires, all of as many segments as the largest; a shorter one's spare nodes come first.

    Everything is set and read in SI units, arrays with the lane first.
    """

    def __init__(
        self,
        pieces: Pieces,
        n: int = 1,
        *,
        step: float = 1e-2,
        steps: int = 10,
        points: int = 1,
        twist: bool = False,
        threads: int | None = None,
        wall: Tube | Bricks | None = None,
    ) -> None:
        self.n, self.nodes, self.points, self.threads = n, pieces.segments + 1, points, threads
        blocks = self.blocks = -(-n // LANES)
        self._par = _zeros(blocks, at.PAR_SIZE)
        self._wire = _zeros(blocks, self.nodes * at.WIRE_STRIDE)
        self._lane = _zeros(blocks, at.LANE_SIZE)
        self._node = _zeros(blocks, self.nodes * at.NODE_STRIDE)
        self._spin = _zeros(blocks, self.nodes * at.SPIN_STRIDE) if twist else None
        self._foot = _zeros(blocks, self.nodes * points * at.FOOT_STRIDE)
        self.wall = wall
        self.table = np.ascontiguousarray(wall.table if isinstance(wall, Tube) else NO_WALL, dtype=np.float64).reshape(
            -1
        )
        self.grid = wall.data if isinstance(wall, Bricks) else np.zeros(0, dtype=np.float32)
        count = min(threads or cores(), blocks)
        size = self.nodes * at.WORK_STRIDE, self.nodes * points * at.LOAD_STRIDE
        self._workspaces = [[_zeros(1, s)[0] for s in (*size, magnetics.POSE_STRIDE * 8)] for _ in range(count)]
        self.gradient, self.contact = np.zeros((2, blocks * LANES, self.nodes, 3))
        self.magnetic = np.zeros(self.nodes, dtype=np.bool_)
        self.rig_none()
        for name, value in (
            ("STEP", step), ("STEPS", steps), ("MOST_MOVE", 1e3), ("FORCE_TOLERANCE", 1e-9), ("STICK", 1e-4),
            ("MOVE_TOLERANCE", 1e-11), ("PATIENCE", 60), ("MEMORY", 1.0),
            ("SPACING", wall.spacing if isinstance(wall, Tube) else 1.0), ("FEED_STIFFNESS", 1e5), ("FEED_FORCE", 10.0),
             ("BASE_TX", 1.0), ("TIP_TX", 1.0),
            *(wall.fields().items() if isinstance(wall, Bricks) else ()),
        ):  # fmt: skip
            self.par(name, value)
        self.take(np.arange(blocks * LANES), pieces)
        straight = np.concatenate([[0.0], np.cumsum(pieces.rest)])
        self.lane_field("BASE_MY", 1.0)
        self.lane_field("TIP_MY", 1.0)
        self.place(np.stack([straight, 0 * straight, 0 * straight], axis=-1))

    def rig_none(self) -> None:
        """No magnets."""
        blocks = self.blocks
        self.rig, self.sources = np.zeros((0, magnetics.SLOTS), dtype=np.int64), np.zeros(0, dtype=np.int64)
        self._magnets, self._dofs = _zeros(blocks, 1), _zeros(blocks, 1)
        self.is_turn = np.zeros(0, dtype=np.bool_)
        self.clouds, self.cloud_of = _zeros(1, magnetics.SOURCE_STRIDE), np.zeros((blocks, 0), dtype=np.int64)
        self._q, self._command = _zeros(blocks, LANES), _zeros(blocks, LANES)

    # --- fields of the packed arrays, lanes first -------------------------------------------------------------------

    def _view(self, array: np.ndarray, stride: int) -> np.ndarray:
        """(blocks, items, fields, LANES)."""
        return array.reshape(len(array), -1, stride // LANES, LANES)

    def _set(
        self, array: np.ndarray, stride: int, offset: int, value: np.ndarray | float, lanes: np.ndarray | None
    ) -> None:
        view = self._view(array, stride)[:, :, offset // LANES]  # (blocks, items, LANES)
        at_lanes = np.arange(self.n) if lanes is None else np.asarray(lanes)
        rows = np.broadcast_to(np.asarray(value, dtype=np.float64), (len(at_lanes), view.shape[1]))
        if lanes is None:  # spare lanes of the last block are copies of the last lane
            at_lanes = np.arange(self.blocks * LANES)
            rows = rows[np.minimum(at_lanes, self.n - 1)]
        block, lane = np.divmod(at_lanes, LANES)
        view[block, :, lane] = rows

    def _get(self, array: np.ndarray, stride: int, offset: int, count: int = 1) -> np.ndarray:
        view = self._view(array, stride)[:, :, offset // LANES : offset // LANES + count]
        return view.transpose(0, 3, 1, 2).reshape(-1, view.shape[1], count)[: self.n]

    def par(self, name: str, value: np.ndarray | float, lanes: np.ndarray | None = None) -> None:
        """Set a parameter of `layout`, one number or (n,)."""
        self._set(self._par, at.PAR_SIZE, getattr(at, name), np.asarray(value, dtype=np.float64)[..., None], lanes)
        self._par.reshape(self.blocks, -1, LANES)[-1, at.STEPS // LANES, self.n - self.blocks * LANES or LANES :] = 0.0

    def wire(self, name: str, value: np.ndarray | float, lanes: np.ndarray | None = None) -> None:
        """Set a property of the wire, one number, (nodes,) or (n, nodes)."""
        self._set(self._wire, at.WIRE_STRIDE, getattr(at, name), value, lanes)

    def lane_field(self, name: str, value: np.ndarray | float, lanes: np.ndarray | None = None) -> None:
        """Set a number of the lanes' state, one number or (n,)."""
        self._set(self._lane, at.LANE_SIZE, getattr(at, name), np.asarray(value, dtype=np.float64)[..., None], lanes)

    def lane(self, name: str, count: int = 1) -> np.ndarray:
        """(n,) or (n, count), a number of the lanes' state."""
        rows = self._get(self._lane, at.LANE_SIZE, getattr(at, name), count)[:, 0]
        return rows[:, 0] if count == 1 else rows

    def vector(self, name: str, value: np.ndarray, lanes: np.ndarray | None = None) -> None:
        """Set a vector parameter by the name of its first component, (3,) or (n, 3)."""
        first, value = getattr(at, name), np.asarray(value, dtype=np.float64)
        lanewise = name.startswith(("BASE_M", "TIP_M"))
        for axis in range(3):
            array, stride = (self._lane, at.LANE_SIZE) if lanewise else (self._par, at.PAR_SIZE)
            self._set(array, stride, first + axis * LANES, value[..., axis, None], lanes)

    def take(self, lanes: np.ndarray, pieces: Pieces) -> None:
        """Give `lanes` a wire."""
        spare = self.nodes - 1 - pieces.segments

        def padded(value: np.ndarray | float, count: int, fill: float) -> np.ndarray:
            out = np.full(self.nodes, fill)
            out[spare : spare + count] = value
            return out

        n = pieces.segments
        curl = np.broadcast_to(pieces.curl, (n + 1, 2))
        for name, value, count, fill in (
            ("REST", pieces.rest, n, float(np.asarray(pieces.rest)[0])), ("AXIAL", pieces.axial, n, 0.0),
            ("RADIUS", pieces.radius, n, 1e-4), ("MOMENT", pieces.moment, n, 0.0), ("AT", pieces.where, n, 0.5),
            ("SPIN_INERTIA", pieces.spin_inertia, n, 0.0), ("BENDING", pieces.bending, n + 1, 0.0),
            ("TWISTING", pieces.twisting, n + 1, 0.0), ("CURL_1", curl[:, 0], n + 1, 0.0),
            ("CURL_2", curl[:, 1], n + 1, 0.0), ("MASS", pieces.mass, n + 1, 0.0), ("DRAG", pieces.drag, n + 1, 0.0),
        ):  # fmt: skip
            self.wire(name, padded(value, count, fill), lanes)
        self.magnetic[spare : spare + n] |= np.broadcast_to(pieces.moment, n) != 0.0
        self.lane_field("FIRST", spare, lanes)

    # --- state ------------------------------------------------------------------------------------------------------

    def place(
        self, positions: np.ndarray, velocities: np.ndarray | float = 0.0, directors: np.ndarray | None = None
    ) -> None:
        """Set the nodes' places (nodes, 3) or (n, nodes, 3) m, velocities m/s, and directors of the segments.

        By default the first director is the base's clamp's, carried along without twist.
        """
        positions = np.broadcast_to(np.asarray(positions, dtype=np.float64), (self.n, self.nodes, 3))
        velocities = np.broadcast_to(np.asarray(velocities, dtype=np.float64), positions.shape)
        for axis in range(3):
            self._set(self._node, at.NODE_STRIDE, at.X + axis * LANES, positions[..., axis], None)
            self._set(self._node, at.NODE_STRIDE, at.VX + axis * LANES, velocities[..., axis], None)
        self.find_feet()
        if self._spin is not None:
            if directors is None:
                start = self.lane("BASE_MX", 3)
                directors = carried(positions, start)
            directors = np.broadcast_to(directors, (self.n, self.nodes - 1, 3))
            directors = np.concatenate([directors, directors[:, -1:]], axis=1)
            for axis in range(3):
                self._set(self._spin, at.SPIN_STRIDE, at.MX + axis * LANES, directors[..., axis], None)
            self._set(self._spin, at.SPIN_STRIDE, at.RATE, 0.0, None)

    def push(self, velocities: np.ndarray) -> None:
        """Set the nodes' velocities (nodes, 3) or (n, nodes, 3) m/s, and nothing else; a held node keeps its own."""
        velocities = np.broadcast_to(np.asarray(velocities, dtype=np.float64), (self.n, self.nodes, 3))
        for axis in range(3):
            self._set(self._node, at.NODE_STRIDE, at.VX + axis * LANES, velocities[..., axis], None)

    def hold(self, nodes: list[int], axes: str = "XYZ", held: bool = True) -> None:
        """Hold nodes along world axes, so that they move at the velocity they are given alone; or let them go."""
        for axis in axes:
            offset = getattr(at, f"HOLD_{axis}")
            rows = self._get(self._wire, at.WIRE_STRIDE, offset)[..., 0].copy()
            rows[:, nodes] = at.HELD if held else 0.0
            self.wire(f"HOLD_{axis}", rows)

    def loads(self, forces: np.ndarray) -> None:
        """Set the dead loads on the nodes, (nodes, 3) or (n, nodes, 3) N."""
        for k, axis in enumerate("XYZ"):
            self.wire(f"FORCE_{axis}", np.asarray(forces)[..., k])

    def feed(self, inserted: np.ndarray | float, path: Callable[[np.ndarray], np.ndarray]) -> None:
        """Lay the wires along a path, `inserted` m of each of them out of the sleeve at its start, at rest.

        path : arc lengths (...) m from the inlet on → points (..., 3) m, straight behind it where negative
        """
        rest = self.rest
        to_tip = np.concatenate([np.cumsum(rest[:, ::-1], axis=1)[:, ::-1], np.zeros((self.n, 1))], axis=1)
        inserted = np.broadcast_to(np.asarray(inserted, dtype=np.float64), (self.n,))
        out = inserted[:, None] - to_tip  # of every node, from the inlet
        # the cell is between a half and three halves of its segment
        first = np.argmax(out + 0.5 * np.concatenate([rest, rest[:, -1:]], axis=1) > 0.0, axis=1)
        first = np.minimum(first, self.nodes - 3)
        first -= out[np.arange(self.n), first] > 0.5 * rest[np.arange(self.n), first]
        first = np.clip(first, 0, self.nodes - 3)
        lanes = np.arange(self.n)
        above = to_tip[lanes, first + 1]
        s = np.where(np.arange(self.nodes) == first[:, None], 0.0, out)
        for name, value in (
            ("FIRST", first), ("OUT", above), ("CELL", inserted - above), ("CELL_START", inserted - above),
            ("CELL_REST", rest[lanes, first]), ("FEED_GOAL", inserted - above), ("FEED_WANT", inserted),
            ("CELL_SPEED", 0.0),
        ):  # fmt: skip
            self.lane_field(name, np.asarray(value, dtype=np.float64), lanes)
        self.par("FED", 1.0)
        self.par("BASE_CLAMPED", 1.0)
        self.vector("BASE_X", path(np.zeros(1))[0])
        x = path(s)
        beyond = np.arange(self.nodes) < first[:, None]
        t = path(np.full(1, -1e-3))[0]
        t = (path(np.zeros(1))[0] - t) / 1e-3
        self.vector("BASE_TX", t / np.linalg.norm(t))
        x[beyond] = (path(np.zeros(1))[0] + np.minimum(s, 0.0)[..., None] * t / np.linalg.norm(t))[beyond]
        self.place(x)

    def contact_points(self, positions: np.ndarray) -> np.ndarray:
        """(n, nodes · points, 3) m; those above the tip coincide with it."""
        above = np.concatenate([positions[:, 1:], positions[:, -1:]], axis=1)
        share = (np.arange(self.points) / self.points)[:, None]
        return (positions[:, :, None] + share * (above - positions)[:, :, None]).reshape(self.n, -1, 3)

    def find_feet(self) -> None:
        """Find the wall's part next to every contact point anew."""
        if not isinstance(self.wall, Tube):
            return
        rows, along = self.wall.feet(self.contact_points(self.positions))
        self._set(self._foot, at.FOOT_STRIDE, at.ROW, rows, None)
        self._set(self._foot, at.FOOT_STRIDE, at.ALONG, along, None)

    @property
    def positions(self) -> np.ndarray:
        """(n, nodes, 3) m."""
        return self._get(self._node, at.NODE_STRIDE, at.X, 3)

    @property
    def velocities(self) -> np.ndarray:
        """(n, nodes, 3) m/s."""
        return self._get(self._node, at.NODE_STRIDE, at.VX, 3)

    @property
    def rest(self) -> np.ndarray:
        """Rest lengths of the segments, (n, segments) m."""
        return self._get(self._wire, at.WIRE_STRIDE, at.REST)[:, :-1, 0]

    @property
    def directors(self) -> np.ndarray:
        """(n, segments, 3); only of wires that twist."""
        if self._spin is None:
            raise ValueError("directors: this wire has no twist; build it with twist=True")
        return self._get(self._spin, at.SPIN_STRIDE, at.MX, 3)[:, :-1]

    # --- motion -----------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """One control period."""

        def run(blocks: np.ndarray, work: list[np.ndarray]) -> None:
            rest = (*work, NO_MARKS, 1.0)
            for b in blocks:
                stepper.run_block(
                    b, self.points, self.magnetic, self._par[b], self._wire[b], self._lane[b], self._node[b],
                    None if self._spin is None else self._spin[b], self._foot[b], self.table, self.grid, self._dofs[b],
                    self.is_turn, self.rig, self._magnets[b], self.clouds, self.cloud_of, self.sources, self._q[b],
                    self._command[b], *rest,
                )  # fmt: skip

        share_out(run, np.arange(self.blocks), self._workspaces, self.threads)  # type: ignore[arg-type]

    def refresh(self) -> None:
        """Bring the forces up to date with the present state."""
        for b in range(self.blocks):
            stepper.publish_alone(
                b, self.points, self.magnetic, self._par[b], self._wire[b], self._lane[b], self._node[b],
                None if self._spin is None else self._spin[b], self._foot[b], self.table, self.grid, self.rig,
                self._magnets[b], self.clouds, self.cloud_of, self.sources, self._q[b], *self._workspaces[0],
            )  # fmt: skip
            work = self._workspaces[0][0].reshape(1, -1)
            view = self._view(work, at.WORK_STRIDE)[0]
            for rows, o in ((self.gradient, at.GRADIENT), (self.contact, at.CONTACT)):
                rows[b * LANES : (b + 1) * LANES] = view[:, o // LANES : o // LANES + 3].transpose(2, 0, 1)


def carried(positions: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Directors (n, segments, 3) carried along wires (n, nodes, 3) from `first` (n, 3) without twist."""
    e = np.diff(positions, axis=1)
    t = e / np.linalg.norm(e, axis=-1, keepdims=True)
    m = first - (first * t[:, 0]).sum(axis=-1, keepdims=True) * t[:, 0]
    out = [m / np.linalg.norm(m, axis=-1, keepdims=True)]
    for i in range(1, t.shape[1]):
        u, w, m = t[:, i - 1], t[:, i], out[-1]
        m = m - (m * w).sum(axis=-1, keepdims=True) / (1 + (u * w).sum(axis=-1, keepdims=True)) * (u + w)
        out.append(m / np.linalg.norm(m, axis=-1, keepdims=True))
    return np.stack(out, axis=1)
