"""The free rod: the paper's chain without a tract, in static equilibrium (paper Section III, Figures 1 and 2).

The chain of `Guidewire` is clamped at the origin along +x; its last node carries the tip magnet, and its segments may
be magnetised themselves. Its energy is

    U = Σ ½ k_axial (|e_i| − ℓ)² + Σ ½ k_j φ_j² − m d̂·B(x_tip) − Σ μ_i d̂_i·B(x̄_i) − F·x_tip − Σ m_i g·x_i

with segment vectors e_i, exact angles φ_j between segments at large deflection in 3-D, d̂_i the direction and x̄_i the
middle of segment i, μ_i the moment it holds, and d̂ the direction of the last segment, along which the tip's moment m
lies. An equilibrium is a minimum of U.

**Joints at the ends.** A joint stands for the wire's bending over the ℓ about its node, so its spring is E·I/ℓ. At the
clamp only half a cell lies between the first segment's middle and the wall: 2 E·I/ℓ. At the tip half a cell lies
between the last segment's middle and the rigid magnet, again 2 E·I/ℓ; since the last segment *is* the magnet's
direction here, that half-cell acts in series with the ordinary joint behind the segment: 1/k = ℓ/E·I + ℓ/(2 E·I). The
compliances then add up to L/E·I exactly, so a couple at the tip turns the last segment by the closed form's angle at
any N, and everything else converges at second order. Full joints, or rigid ends, are first order instead
(0.3–0.7 % off at 200 segments).

**Solution.** SciPy's `trust-exact` minimises U with its exact gradient and Hessian over two rotations and one stretch a
segment (a stereographic chart about the segment's current direction). In node coordinates the axial springs, stiffer
by (2L/r)², would forbid any but tiny rotations; here they do not. Newton steps polish the result, and the Cholesky
factors of its Hessian show that it is a minimum. All of it runs in units of L and E·I/L.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.optimize import minimize

from .checks import points_array, positive, vector
from .dipoles import MU0, DipoleCloud
from .guidewire import Guidewire
from .magnets import CylinderMagnet, Magnet
from .rod_energy import Chain, Chart, Load, Shape, Touched, off_saddle
from .rod_magnetics import Magnetisation, carriers_of, reference_moment, segment_moments

if TYPE_CHECKING:
    from .inverse import Curve, ShapeSolution, TipPose
    from .inverse.means import RigLike

__all__ = ["FreeRod", "NotConverged", "RodPath"]

Vector = Sequence[float] | np.ndarray

_COARSE = 1e-6  # gradient, in E·I/L, at which the trust region hands over to plain Newton steps
_ITERATIONS = 60  # of the trust region between two charts
_CHARTS = 8  # fresh charts, or kicks off a saddle, before giving up


class _Stride(NamedTuple):
    """What one step along a branch may be: the turn of a segment (rad), the way of the tip past a dipole (in their
    distance), and the shortest step, a share of the way between two loads, before the branch counts as ended."""

    turn: float
    approach: float
    shortest: float


_BRANCH = _Stride(turn=0.3, approach=0.3, shortest=2.0**-12)
_RAMP = _Stride(turn=1.0, approach=0.6, shortest=2.0**-6)  # from rest, where any equilibrium will do


class NotConverged(RuntimeError):
    """No stable equilibrium was reached.

    residual : norm of the energy's gradient where the search ended (before contact, if that ended it), in units of
        E·I/L; infinite if it could not start
    touched : whether the tip came into contact with a magnet
    """

    def __init__(self, residual: float, touched: bool = False) -> None:
        super().__init__(residual, touched)
        self.residual = residual
        self.touched = touched

    def __str__(self) -> str:
        reason = "the tip is drawn into contact with a magnet" if self.touched else "no stable equilibrium found"
        return f"{reason}; gradient norm {self.residual:.3g} E·I/L"


class RodPath(NamedTuple):
    """Equilibria along a sequence of n loads.

    positions : (n, nodes, 3) m, NaN where not converged
    converged : (n,) bool
    snap : index of the first load that the branch does not reach, whether the rod jumps to another equilibrium on
        the way there (converged) or finds none, as in contact with a magnet (not converged); None if there is none
    """

    positions: np.ndarray
    converged: np.ndarray
    snap: int | None


class _Found(NamedTuple):
    shape: Shape
    residual: float
    converged: bool
    touched: bool


class FreeRod:
    """A wire clamped at the origin along +x, its tip magnet free.

    wire : its segments, stiffness and, for `gravity`, mass; `ValueError` for one with profiles along it
    tip : the magnet at the last node; its moment points along the last segment, outwards. None for a rod that is
        magnetised along its length alone
    magnetisation : moment along the tangent per length of wire, A·m²/m: a function of the arc length from the clamp,
        (n,) m → (n,), or one number for each segment; by default none
    gravity : (3,) m/s², zero as in the paper
    contact : m; a tip (or the middle of a magnetised segment) nearer than this to a dipole of a cloud touches the
        magnet, and no equilibrium is looked for there. Default: the tip magnet's `reach` (the wire's radius without
        one), at least 1 % of the wire. A cloud does not know its magnet's body: a tip drawn inside goes on to one of
        its dipoles, and wire that is not magnetised passes through magnets.
    tolerance : on the gradient's norm, in units of E·I/L

    A load is given by keywords, all optional:

    cloud : `DipoleCloud`, the external magnets in the rod's frame
    uniform_field : (3,) T
    tip_force : (3,) N, dead
    """

    def __init__(
        self,
        wire: Guidewire,
        tip: Magnet | None,
        *,
        magnetisation: Magnetisation | None = None,
        gravity: Vector = (0.0, 0.0, 0.0),
        contact: float | None = None,
        tolerance: float = 1e-9,
    ) -> None:
        for name, value, kind in (("wire", wire, Guidewire), ("tip", tip, Magnet | None)):
            known = isinstance(value, kind)
            if not known:
                raise ValueError(f"FreeRod.{name} must be a {name} from magwire_env.physics, got {value!r}")
        for name in wire.profiled:
            if name not in ("twisting", "outer_radius"):  # no twist, and contact is the tip's
                raise ValueError(
                    f"FreeRod.wire must be uniform, without Guidewire.{name} (a profile); simulate it with "
                    f'Scenario(model="free") instead, got {getattr(wire, name)!r}'
                )
        self.wire = wire
        self.tip = tip
        self.segment_moments = segment_moments("FreeRod.magnetisation", magnetisation, wire.segments, wire.length)
        tip_moment = tip.moment if tip is not None else 0.0
        self.reference_moment = reference_moment(tip_moment, self.segment_moments)
        self.gravity = vector("FreeRod.gravity", gravity, 3, "m/s²")
        default = max(wire.radius if tip is None else tip.reach, 0.01 * wire.length)
        self.contact = default if contact is None else positive("FreeRod.contact", contact, "m")
        self.tolerance = positive("FreeRod.tolerance", tolerance, "E·I/L")
        carriers = carriers_of(tip_moment, self.segment_moments, self.reference_moment)
        self._chain = Chain(wire, self.contact, carriers)
        self._rest = Shape(np.tile([1.0, 0.0, 0.0], (wire.segments, 1)), np.zeros(wire.segments))

    def equilibrium(
        self,
        cloud: DipoleCloud | None = None,
        uniform_field: Vector = (0.0, 0.0, 0.0),
        tip_force: Vector = (0.0, 0.0, 0.0),
        start: np.ndarray | None = None,
    ) -> np.ndarray:
        """Node positions in stable equilibrium, (nodes, 3) m.

        The one the straight rod relaxes to, under the load at full strength or, failing that, under the load as it
        grows; or the one it relaxes to from `start`, (nodes, 3) m. Others may exist. Raises `NotConverged`.
        """
        load = self._load(cloud, uniform_field, tip_force)
        if start is None:
            return self._positions(self._settled(load))
        found = self._minimise(load, self._shape("start", start))
        if not found.converged:
            raise NotConverged(found.residual, found.touched)
        return self._positions(found.shape)

    def path(self, loads: Sequence[Mapping[str, Any]]) -> RodPath:
        """Equilibria under `loads`, a sequence of mappings with the keywords of `equilibrium` (but `start`).

        The first is reached as by `equilibrium`, each next from the one before by steps so short that no segment
        turns by more than 0.3 rad and no dipole moves, seen from the tip, by more than 30 % of its distance. In
        between, forces and fields are interpolated, and so are the dipoles' positions and moments; a cloud of another
        size fades in where it stands. Where no step is short enough (1/4096 of the way) the branch has ended: a snap.
        A rod that then finds another equilibrium goes on from there; otherwise the path ends, and it and all later
        loads are reported as not converged.
        """
        series = [self._load(**_keywords(i, load)) for i, load in enumerate(loads)]
        positions = np.full((len(series), self.wire.segments + 1, 3), np.nan)
        converged = np.zeros(len(series), dtype=bool)
        shape, snap = self._rest, None
        for i, load in enumerate(series):
            try:
                shape, jumped = self._follow(shape, series[i - 1], load, _BRANCH) if i else (self._settled(load), False)
            except NotConverged:
                return RodPath(positions, converged, i if snap is None else snap)
            snap = i if jumped and snap is None else snap
            positions[i], converged[i] = self._positions(shape), True
        return RodPath(positions, converged, snap)

    def field_for(self, target: Curve | TipPose | np.ndarray, *, limit: float = 1.0, starts: int = 12) -> ShapeSolution:
        """The uniform field that brings the rod nearest to a shape or a tip's pose.

        target : `Curve`, `TipPose`, or (n, 3) m of points equally spaced along the wire from the clamp to the tip
        limit : T, of the field's strength
        starts : of the search at most; it ends at the first that reaches the target from rest

        A shape that cannot be reached is no error: the solution says so, and why (`ShapeSolution.reached`, `.why`).
        """
        from .inverse import solve
        from .inverse.means import UniformField
        from .inverse.targets import as_target

        moment = float(np.abs(self.segment_moments).sum()) + (self.tip.moment if self.tip is not None else 0.0)
        return solve(self, as_target(target), UniformField(self.wire, moment, limit), starts)

    def rig_for(self, target: Curve | TipPose | np.ndarray, rig: RigLike, *, starts: int = 12) -> ShapeSolution:
        """The command of a rig (turns, slides, currents) that brings the rod nearest to a shape or a tip's pose.

        rig : a `magwire_env.scenario.Rig`, or what has its magnets and coils; placed in the rod's frame
        target, starts : as for `field_for`

        Turns are free, slides and currents keep their limits, and a magnet keeps its reach and the wire's radius
        clear of every node. Raises `ValueError` if the rod has no equilibrium at any start.
        """
        from .inverse import solve
        from .inverse.means import RigMeans
        from .inverse.targets import as_target

        return solve(self, as_target(target), RigMeans(self.wire, rig), starts)

    def energy(self, positions: np.ndarray, **load: Any) -> float:
        """Total energy of the rod at `positions`, (nodes, 3) m, under a load, J; infinite in contact."""
        shape = self._shape("positions", positions)
        return self._chain.first(self._load(**load), shape)[0] * self._chain.moment

    def forces(self, positions: np.ndarray, **load: Any) -> np.ndarray:
        """Net force on each free node, minus the gradient of `energy`: (nodes, 3) m → (nodes, 3) N.

        In equilibrium these are zero. The first row is the force with which the rod pulls at the clamp.
        """
        shape, scaled = self._shape("positions", positions), self._load(**load)
        energy, on_directions, on_strains = self._chain.first(scaled, shape)
        if not math.isfinite(energy):
            raise ValueError("positions must keep the tip out of contact with the cloud, where forces are not defined")
        d = shape.directions
        lengths = self._chain.cell * (1 + shape.strains)
        across = on_directions - d * np.einsum("nj,nj->n", d, on_directions)[:, None]
        tension = across / lengths[:, None] + d * (on_strains / self._chain.cell)[:, None]
        total = np.zeros((len(d) + 1, 3))
        total[:-1] += tension
        total[1:] -= tension
        total[0] += self._chain.hold(scaled, shape)  # the derivatives shift a segment with all that hangs on it
        return total * self._chain.moment / self.wire.length

    def _units(self) -> tuple[float, float]:
        """A `Load`'s couple by the uniform field, 1/T, and its moments by a dipole's, 1/(A·m²)."""
        couple = self.reference_moment / self._chain.moment
        return couple, MU0 / (4 * np.pi) * couple / self.wire.length**3

    def _load(
        self,
        cloud: DipoleCloud | None = None,
        uniform_field: Vector = (0.0, 0.0, 0.0),
        tip_force: Vector = (0.0, 0.0, 0.0),
    ) -> Load:
        if cloud is not None and not isinstance(cloud, DipoleCloud):
            raise ValueError(f"cloud must be a DipoleCloud or None, got {type(cloud).__name__}")
        length, n, moment = self.wire.length, self.wire.segments, self._chain.moment
        tip_mass = self.tip.mass if isinstance(self.tip, CylinderMagnet) else 0.0
        hanging = (tip_mass or 0.0) + self.wire.mass / n * (np.arange(n)[::-1] + 0.5)
        dead = np.add(np.outer(hanging, self.gravity), vector("tip_force", tip_force, 3, "N"))
        per_tesla, strength = self._units()
        couple = np.array(vector("uniform_field", uniform_field, 3, "T")) * per_tesla
        positions = np.zeros((0, 3)) if cloud is None else cloud.positions / length
        moments = np.zeros((0, 3)) if cloud is None else cloud.moments
        return Load(dead * length / moment, couple, positions, moments * strength)

    def _shape(self, name: str, positions: np.ndarray) -> Shape:
        nodes = points_array(name, positions, "m")
        if len(nodes) != self.wire.segments + 1 or np.abs(nodes[0]).max() > 1e-9 * self.wire.length:
            raise ValueError(
                f"{name} must be ({self.wire.segments + 1}, 3) m with its first node at the origin, "
                f"got shape {nodes.shape} from {nodes[0].tolist() if len(nodes) else []}"
            )
        segments = np.diff(nodes, axis=0)
        lengths = np.linalg.norm(segments, axis=1)
        if not lengths.all():
            raise ValueError(f"{name} must have distinct neighbours, got node {int(lengths.argmin())} twice")
        return Shape(segments / lengths[:, None], lengths / self.wire.segment_length - 1)

    def _positions(self, shape: Shape) -> np.ndarray:
        segments = shape.directions * (self.wire.segment_length * (1 + shape.strains))[:, None]
        return np.concatenate([np.zeros((1, 3)), np.cumsum(segments, axis=0)])

    def _settled(self, load: Load) -> Shape:
        """The shape the straight rod settles in."""
        found = self._minimise(load, self._rest)
        return found.shape if found.converged else self._follow(self._rest, load.unloaded(), load, _RAMP)[0]

    def _follow(self, shape: Shape, before: Load, after: Load, stride: _Stride) -> tuple[Shape, bool]:
        """From equilibrium `shape` under `before` to one under `after`, and whether it jumped on the way."""
        done, step, jumped = 0.0, 1.0, False
        while done < 1:
            target = min(1.0, done + step)
            last, load = before.towards(after, done), before.towards(after, target)
            found = self._minimise(load, shape)
            excess = self._excess(shape, found, last, load, stride)
            if excess <= 1:
                done, step, shape = target, 2 * step, found.shape
            elif step > stride.shortest:
                step = max(stride.shortest, (target - done) * min(0.5, max(0.1, 0.7 / excess)))
            elif found.converged:
                done, shape, jumped = target, found.shape, True
            elif found.touched or target == 1:
                raise NotConverged(found.residual, found.touched)
            else:  # hardly past the end of its branch a rod may have next to no slope to leave along: go further
                stride, step = stride._replace(shortest=2 * step), 2 * step
        return shape, jumped

    def _excess(self, shape: Shape, found: _Found, last: Load, load: Load, stride: _Stride) -> float:
        """How far rod and magnets went, as a multiple of what `stride` allows; infinite if nothing was found."""
        if not found.converged:
            return math.inf
        chord = np.linalg.norm(found.shape.directions - shape.directions, axis=1).max()
        turn = 2 * math.asin(min(1.0, chord / 2))
        before = self._chain.places(shape)[:, None] - last.positions
        after = self._chain.places(found.shape)[:, None] - load.positions
        nearer = np.linalg.norm(after - before, axis=2) / np.linalg.norm(before, axis=2)
        return max(turn / stride.turn, nearer.max(initial=0.0) / stride.approach)

    def _minimise(self, load: Load, shape: Shape) -> _Found:
        """A minimum of the energy near `shape`; off saddles, never into contact."""
        n = self.wire.segments
        options = {
            "gtol": _COARSE,
            "maxiter": _ITERATIONS,
            "initial_trust_radius": 0.5 * math.sqrt(n),
            "max_trust_radius": math.sqrt(n),
        }
        residual = math.inf
        for _ in range(_CHARTS):
            chart = Chart(self._chain, load, shape)
            try:
                result = minimize(
                    chart.value, chart.middle, jac=True, hess=chart.damped, method="trust-exact", options=options
                )
                shape, residual, stable = self._polish(load, chart.shape(result.x))
            except Touched:
                return _Found(shape, chart.residual(), False, True)
            if residual < self.tolerance and stable:
                return _Found(shape, residual, True, False)
            if residual < _COARSE and not stable:
                shape = off_saddle(Chart(self._chain, load, shape))
        return _Found(shape, residual, False, False)

    def _nearby(self, load: Load, shape: Shape) -> _Found:
        """The minimum of the energy right beside `shape`, by Newton steps alone if they get there."""
        try:
            near, residual, stable = self._polish(load, shape, math.inf)
        except Touched:
            return self._minimise(load, shape)
        return (
            _Found(near, residual, True, False) if residual < self.tolerance and stable else self._minimise(load, shape)
        )

    def _polish(self, load: Load, shape: Shape, most: float = 1e3 * _COARSE) -> tuple[Shape, float, bool]:
        """Newton steps from a gradient of at most `most` on, while they help: the shape, its gradient's norm, and
        whether its Hessian is positive."""
        best, residual, stable = shape, math.inf, False
        while True:
            chart = Chart(self._chain, load, shape)
            gradient = chart.value(chart.middle)[1]
            norm = float(np.linalg.norm(gradient))
            if not norm < 0.5 * residual:
                return best, residual, stable
            best, residual = shape, norm
            try:
                factor = cho_factor(chart.damped(chart.middle))
            except LinAlgError:
                return best, residual, False
            stable = True
            if residual > most:
                return best, residual, stable
            shape = chart.shape(-cho_solve(factor, gradient))


def _keywords(index: int, load: Mapping[str, Any]) -> Mapping[str, Any]:
    allowed = ("cloud", "uniform_field", "tip_force")
    if not isinstance(load, Mapping) or not set(load) <= set(allowed):
        raise ValueError(f"loads[{index}] must be a mapping with keys among {', '.join(allowed)}, got {load!r}")
    return load
