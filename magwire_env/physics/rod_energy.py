"""Energy of a free chain of springs that carries magnets, with its first and second derivatives.

What `rod.FreeRod` minimises; the model is described there. Everything runs in units of the wire's length L and of
E·I/L, over segment directions and strains instead of node positions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from . import rod_magnetics as magnetics
from .guidewire import Guidewire
from .rod_magnetics import Carriers

__all__ = ["Chain", "Chart", "Load", "LoadSlope", "Shape", "Touched", "off_saddle"]

_NEUTRAL = 2.5e-6  # stiffness, in E·I/L and per segment, below which a mode counts as neutral and not as falling

_KICK = 0.05  # rad, off a saddle


class Shape(NamedTuple):
    """Segment directions (N, 3), unit vectors, and strains (N,)."""

    directions: np.ndarray
    strains: np.ndarray


class Touched(Exception):
    """The rod's own magnets have come into contact with one outside."""


@dataclass(frozen=True)
class Load:
    """A load in units of L and E·I/L.

    pull : (N, 3), the dead force each segment carries (tip force, and weight of all that hangs on it)
    couple : (3,), m B of the uniform field, m the rod's reference moment
    positions, moments : (K, 3), dipoles; moments scaled by m, so that their field along d̂ is an energy
    """

    pull: np.ndarray
    couple: np.ndarray
    positions: np.ndarray
    moments: np.ndarray

    def towards(self, other: Load, share: float) -> Load:
        """The load `share` of the way to `other`: dipoles move if the clouds correspond, else fade over."""
        rest = 1 - share
        if len(self.moments) == len(other.moments):
            positions = rest * self.positions + share * other.positions
            moments = rest * self.moments + share * other.moments
        else:
            positions = np.concatenate([self.positions, other.positions])
            moments = np.concatenate([rest * self.moments, share * other.moments])
        pull = rest * self.pull + share * other.pull
        return Load(pull, rest * self.couple + share * other.couple, positions, moments)

    def unloaded(self) -> Load:
        """The same dipoles in the same place, all strengths zero."""
        return Load(0 * self.pull, 0 * self.couple, self.positions, 0 * self.moments)


class LoadSlope(NamedTuple):
    """The rate at which a load changes with a parameter, in the load's units.

    couple : (3,) of the uniform field
    positions, moments : (K, 3), of the dipoles
    """

    couple: np.ndarray
    positions: np.ndarray
    moments: np.ndarray


class Chain:
    """Energy of the chain over directions and strains, in units of L and E·I/L.

    carriers : the magnets along it, moments as multiples of the reference moment
    """

    def __init__(self, wire: Guidewire, contact: float, carriers: Carriers) -> None:
        n = wire.segments
        self.carriers = carriers
        self.cell = 1 / n
        self.moment = wire.bending_rigidity / wire.length
        self.contact = contact / wire.length
        self.joints = np.full(n, float(n))
        self.joints[0] *= 2
        self.joints[-1] *= 2 / 3
        self.axial = wire.axial_rigidity * wire.segment_length / self.moment
        self.stretch = math.sqrt(2 * n / self.axial)
        """Strain of one unit of the chart's third coordinate: as stiff as a rotation against two joints."""
        self.base = np.array([[1.0, 0.0, 0.0]])
        self._later = np.kron(np.triu(np.ones((n, n), dtype=bool), 1), np.ones((3, 3), dtype=bool))

    def places(self, shape: Shape) -> np.ndarray:
        """Where the rod's magnets are, (C, 3)."""
        return self.carriers.places((self.cell * (1 + shape.strains))[:, None] * shape.directions)

    def pull(self, load: Load, shape: Shape) -> np.ndarray:
        """Force that each segment carries from outside, dead and magnetic, (N, 3)."""
        if not len(load.moments):
            return load.pull
        return load.pull + self.carriers.carried(self._magnetic(load, shape)[1], len(load.pull))

    def hold(self, load: Load, shape: Shape) -> np.ndarray:
        """Whole force on the rod from outside, without what is dead on its first half cell, (3,)."""
        return load.pull[0] + (self._magnetic(load, shape)[1].sum(axis=0) if len(load.moments) else 0.0)

    def _magnetic(self, load: Load, shape: Shape) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """V (C,), force (C, 3) and field times moment (C, 3) of every carrier, by the dipoles alone."""
        own = self.carriers
        along = shape.directions[own.segment]
        found = magnetics.first(load.positions, load.moments, self.places(shape), along, self.contact)
        value, force, field = found
        return own.moment * value, own.moment[:, None] * force, own.moment[:, None] * field

    def first(self, load: Load, shape: Shape) -> tuple[float, np.ndarray, np.ndarray]:
        """Energy and its derivatives by directions (N, 3), as if these were free vectors, and by strains (N,)."""
        d, strains = shape
        inner = np.concatenate([self.base, d[:-1]])
        phi, slope, _ = _angles(inner, d)
        slope = self.joints * slope
        on_d = slope[:, None] * inner
        on_d[:-1] += slope[1:, None] * d[1:]
        lengths = self.cell * (1 + strains)
        own = self.carriers
        energy = 0.5 * self.joints @ phi**2 + 0.5 * self.axial * strains @ strains
        energy -= lengths @ np.einsum("nj,nj->n", load.pull, d)
        energy -= own.moment @ (d[own.segment] @ load.couple)
        pull, field = load.pull, own.moment[:, None] * load.couple
        if len(load.moments):
            value, force, b = self._magnetic(load, shape)
            if not np.isfinite(value).all():
                return math.inf, on_d, strains
            energy -= value.sum()
            pull, field = pull + own.carried(force, len(d)), field + b
        on_d -= lengths[:, None] * pull
        np.add.at(on_d, own.segment, -field)
        on_strains = self.axial * strains - self.cell * np.einsum("nj,nj->n", pull, d)
        return float(energy), on_d, on_strains

    def slope(self, load: Load, shape: Shape, rate: LoadSlope) -> tuple[np.ndarray, np.ndarray]:
        """Rates of the derivatives of `first`, by directions (N, 3) and by strains (N,), while the shape stays."""
        own, (d, strains) = self.carriers, shape
        on_d, field = np.zeros_like(d), own.moment[:, None] * rate.couple
        on_strains = np.zeros(len(d))
        if len(load.moments):
            change = rate.positions, rate.moments
            moved = magnetics.moved(load.positions, load.moments, self.places(shape), d[own.segment], *change)
            force, b = (own.moment[:, None] * value for value in moved)
            pull, field = own.carried(force, len(d)), field + b
            on_d -= (self.cell * (1 + strains))[:, None] * pull
            on_strains = -self.cell * np.einsum("nj,nj->n", pull, d)
        np.add.at(on_d, own.segment, -field)
        return on_d, on_strains

    def second(self, load: Load, shape: Shape, moves: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """Second derivatives of the dipoles' energy, (3N, 3N), by 3 coordinates of each segment.

        moves : (N, 3, 3), how each coordinate moves the segment's vector; turns : (N, 3, 3), its direction
        """
        own, n = self.carriers, len(moves)
        along = shape.directions[own.segment]
        second = magnetics.second(load.positions, load.moments, self.places(shape), along)
        by_place, by_both = (own.moment[:, None, None] * value for value in second)
        flat = moves.reshape(3 * n, 3)

        # A carrier moves with every segment before its own, and with its own by its share; it turns with its own.
        ahead = np.einsum("nij,nkj->nik", own.carried(by_place, n), moves)  # (N, 3 of space, 3 coordinates)
        ahead += np.einsum("nij,nkj->nik", own.by_segment(by_both, n), turns)
        across = flat @ ahead.transpose(1, 0, 2).reshape(3, 3 * n)
        out = np.where(self._later, across, 0.0)
        out += out.T

        beyond = own.carried(by_place, n) - own.by_segment(own.share[:, None, None] * by_place, n)
        beyond += own.by_segment((own.share**2)[:, None, None] * by_place, n)
        same = np.einsum("nij,njk,nlk->nil", moves, beyond, moves)
        partly = own.by_segment(own.share[:, None, None] * by_both, n)
        mixed = np.einsum("nij,njk,nlk->nil", moves, partly, turns)
        every = np.arange(n)
        out.reshape(n, 3, n, 3)[every, :, every] += same + mixed + mixed.transpose(0, 2, 1)
        return -out


class Chart:
    """Shapes near a given one by 3N numbers: two rotations (u, v) and a scaled stretch w for each segment.

    Stereographic: with n the segment's direction in the middle of the chart, a and b across it, q = (u² + v²)/4,
    d = ((1 − q) n + u a + v b)/(1 + q), which covers every direction but −n.
    """

    def __init__(self, chain: Chain, load: Load, shape: Shape) -> None:
        self.chain, self.load = chain, load
        self.normal, self.strains = shape
        self.across = _across(self.normal)
        self.middle = np.zeros(self.normal.size)

    def shape(self, p: np.ndarray) -> Shape:
        uvw = p.reshape(-1, 3)
        q = np.einsum("ni,ni->n", uvw[:, :2], uvw[:, :2])[:, None] / 4
        d = ((1 - q) * self.normal + np.einsum("ni,nij->nj", uvw[:, :2], self.across)) / (1 + q)
        d /= np.linalg.norm(d, axis=1)[:, None]
        return Shape(d, self.strains + self.chain.stretch * uvw[:, 2])

    def value(self, p: np.ndarray) -> tuple[float, np.ndarray]:
        """Energy and its gradient (3N,); infinite where a segment is inside out. Raises `Touched` in contact."""
        shape = self.shape(p)
        if shape.strains.min() <= -1:
            return math.inf, np.full_like(p, math.inf)
        energy, on_d, on_strains = self.chain.first(self.load, shape)
        if not math.isfinite(energy):
            raise Touched
        gradient = np.empty((len(on_d), 3))
        gradient[:, :2] = np.einsum("nij,nj->ni", self._turns(p, shape.directions), on_d)
        gradient[:, 2] = on_strains * self.chain.stretch
        return energy, gradient.ravel()

    def residual(self) -> float:
        """Norm of the gradient in the middle of the chart; infinite in contact."""
        try:
            return float(np.linalg.norm(self.value(self.middle)[1]))
        except Touched:
            return math.inf

    def _turns(self, p: np.ndarray, d: np.ndarray) -> np.ndarray:
        """∂d/∂(u, v), (N, 2, 3)."""
        uv = p.reshape(-1, 3)[:, :2]
        wide = 1 + np.einsum("ni,ni->n", uv, uv)[:, None, None] / 4
        return (self.across - uv[:, :, None] / 2 * (self.normal + d)[:, None, :]) / wide

    def hessian(self, p: np.ndarray) -> np.ndarray:
        """Second derivatives of the energy, (3N, 3N)."""
        shape, chain = self.shape(p), self.chain
        d, _ = shape
        n, uv = len(d), p.reshape(-1, 3)[:, :2]
        turns = self._turns(p, d)
        _, on_d, _ = chain.first(self.load, shape)
        h = np.zeros((n, 3, n, 3))
        every, inner, outer = np.arange(n), np.arange(n - 1), np.arange(1, n)

        # curvature of the chart: ∂²d/∂u_i∂u_j · ∂U/∂d = −(u_i d_j + u_j d_i + δ_ij (n + d))/2(1 + q) · ∂U/∂d
        wide = 1 + np.einsum("ni,ni->n", uv, uv)[:, None, None] / 4
        along = np.einsum("nij,nj->ni", turns, on_d)
        bent = uv[:, :, None] * along[:, None, :]
        bent = bent + bent.transpose(0, 2, 1)
        bent += np.einsum("nj,nj->n", self.normal + d, on_d)[:, None, None] * np.eye(2)
        blocks = -bent / (2 * wide)

        # joints, energy ψ(c) of the cosine c between neighbours
        before = np.concatenate([chain.base, d[:-1]])
        _, slope, curve = _angles(before, d)
        slope, curve = chain.joints * slope, chain.joints * curve
        c_out = np.einsum("nij,nj->ni", turns, before)
        c_in = np.einsum("nij,nj->ni", turns[:-1], d[1:])
        blocks += curve[:, None, None] * c_out[:, :, None] * c_out[:, None, :]
        blocks[:-1] += curve[1:, None, None] * c_in[:, :, None] * c_in[:, None, :]
        mixed = curve[1:, None, None] * c_in[:, :, None] * c_out[1:, None, :]
        mixed += slope[1:, None, None] * np.einsum("nik,njk->nij", turns[:-1], turns[1:])
        h[every, :2, every, :2] = blocks
        h[inner, :2, outer, :2] = mixed
        h[outer, :2, inner, :2] = mixed.transpose(0, 2, 1)

        self._add_loads(h, shape, turns)
        return h.reshape(3 * n, 3 * n)

    def damped(self, p: np.ndarray) -> np.ndarray:
        """The Hessian, lifted by a millionth of the softest bending mode.

        A rod that may turn freely about its axis (a buckled one in an axial field) has a mode of no stiffness at all,
        which rounding would make a saddle or a wild step.
        """
        return self.hessian(p) + _NEUTRAL * self.chain.cell * np.eye(len(p))

    def _add_loads(self, h: np.ndarray, shape: Shape, turns: np.ndarray) -> None:
        """Into the Hessian `h`: axial springs, dead pulls, dipoles."""
        chain, load = self.chain, self.load
        d, strains = shape
        n, every = len(d), np.arange(len(d))
        lengths = chain.cell * (1 + strains)
        if len(load.moments):
            stretches = chain.cell * chain.stretch * d[:, None]
            moves = np.concatenate([lengths[:, None, None] * turns, stretches], axis=1)
            h.reshape(3 * n, 3 * n)[...] += chain.second(load, shape, moves, _padded(turns))
        stretched = chain.cell * chain.stretch * np.einsum("nij,nj->ni", turns, chain.pull(load, shape))
        h[every, :2, every, 2] -= stretched
        h[every, 2, every, :2] -= stretched
        h[every, 2, every, 2] += chain.axial * chain.stretch**2


def _angles(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles φ between unit vectors (n, 3), and ψ' and ψ'' of ψ(cos φ) = φ²/2, all (n,).

    φ = 2 atan2(|b − a|, |b + a|) keeps full precision from 0 to π. ψ' = −φ/sin φ and ψ'' = (1 − φ cot φ)/sin² φ;
    below 0.05 rad they are series, off by less than 1e-9 of their value.
    """
    phi = 2 * np.arctan2(np.linalg.norm(b - a, axis=1), np.linalg.norm(b + a, axis=1))
    small = phi < 0.05
    safe = np.where(small, 1.0, phi)
    sine = np.maximum(np.sin(safe), 1e-9)  # folded right back (φ = π) the couple has no direction: keep it finite
    slope = np.where(small, 1 + phi**2 / 6 + 7 / 360 * phi**4, safe / sine)
    curve = np.where(small, 1 / 3 + 2 / 15 * phi**2 + 2 / 63 * phi**4, (1 - safe * np.cos(safe) / sine) / sine**2)
    return phi, -slope, curve


def off_saddle(chart: Chart) -> Shape:
    """The shape in the middle of `chart`, kicked downhill.

    The kick is what a small turn towards +z and a little +y has in the directions of negative curvature, so that the
    way a symmetric rod buckles does not hang on how the eigenvectors of a double root come out.
    """
    values, modes = eigh(chart.hessian(chart.middle))
    falling = modes[:, values < max(0.0, 0.5 * values[0])]
    falling = falling if falling.size else modes[:, :1]
    turn = np.zeros((len(chart.normal), 3))
    turn[:, :2] = chart.across @ np.array([0.0, 0.3, 1.0])
    kick = falling @ (falling.T @ turn.ravel())
    kick = kick if np.abs(kick).max() > 1e-6 else falling[:, 0]
    return chart.shape(_KICK / np.abs(kick).max() * kick)


def _padded(turns: np.ndarray) -> np.ndarray:
    """Turns by the two rotations of each segment, with a row of zeros for its stretch: (N, 2, 3) → (N, 3, 3)."""
    return np.concatenate([turns, np.zeros((len(turns), 1, 3))], axis=1)


def _across(n: np.ndarray) -> np.ndarray:
    """Two unit vectors across each of the unit vectors `n`: (N, 3) → (N, 2, 3) (Duff et al., JCGT 2017)."""
    x, y, z = n.T
    sign = np.copysign(1.0, z)
    f = -1 / (sign + z)
    g = x * y * f
    first = np.stack([1 + sign * x * x * f, sign * g, -sign * x], axis=1)
    return np.stack([first, np.stack([g, sign + y * y * f, -y], axis=1)], axis=1)
