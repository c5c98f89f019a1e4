"""Algorithm 1 letter by letter, slow and obvious: what the product is held against.

Plain NumPy. A joint is a point in space, not an arc length: each step moves it along its tangent and then snaps it onto
the closest point of the spline. Integration is explicit, so the step must be about a twentieth of a millisecond. The
spline is the natural cubic through the tract's control points over chord length; nothing but parameters comes from
the package.
"""

import numpy as np
from scipy.interpolate import CubicSpline

MU0 = 4e-7 * np.pi


def unit(x: np.ndarray) -> np.ndarray:
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=-1)


class Spline:
    """The tract's centreline as a curve in space."""

    def __init__(self, points) -> None:
        xyz = np.asarray(points)
        chord = np.r_[0.0, np.linalg.norm(np.diff(xyz, axis=0), axis=1).cumsum()]
        self.curve = CubicSpline(chord, xyz, bc_type="natural")
        self.first, self.second = self.curve.derivative(1), self.curve.derivative(2)
        self.samples = np.linspace(0.0, chord[-1], 20_001)

    def closest(self, x: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
        """Parameters of the closest points to x (n, 3), by Newton from `near` or from the closest of many samples."""
        if near is None:
            sampled = self.curve(self.samples)
            near = self.samples[[((sampled - p) ** 2).sum(axis=1).argmin() for p in x]]
        for _ in range(2):
            gap, rate = self.curve(near) - x, self.first(near)
            near = near - dot(gap, rate) / (dot(rate, rate) + dot(gap, self.second(near)))
        return near

    def frame(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, unit tangent, and curvature vector κ n."""
        rate, bend = self.first(u), self.second(u)
        t = unit(rate)
        return self.curve(u), t, (bend - dot(bend, t)[:, None] * t) / dot(rate, rate)[:, None]


class Oracle:
    """One wire under one magnet that turns about y.

    scenario : what to simulate
    positions : (nodes, 3) m, where the joints start, at rest
    angle : t → rad, the magnet's angle over time
    step : s
    """

    def __init__(self, scenario, positions: np.ndarray, angle, step: float) -> None:
        self.sc, self.angle, self.h, self.time = scenario, angle, step, 0.0
        wire, (mount,) = scenario.wire, scenario.rig.magnets
        self.cloud, self.centre = mount.magnet.dipoles(*mount.dipoles), np.array(mount.position)
        share = np.r_[0.5, np.ones(wire.segments - 1), 0.5]
        self.mass = share * wire.mass / wire.segments
        self.mass[-1] += scenario.tip.mass
        self.drag = share * scenario.contact.drag * wire.segment_length
        self.spline = Spline(scenario.tract.points)
        self.u = self.spline.closest(positions)
        self.x, self.t, self.bend = self.spline.frame(self.u)
        self.v = np.zeros(len(positions))

    def run(self, steps: int) -> np.ndarray:
        """(nodes, 3) m after so many steps of Algorithm 1."""
        for _ in range(steps):
            self.step()
        return self.x

    def step(self) -> None:
        magnetic, field = self.magnetic_force()  # i
        springs = self.spring_forces()  # iii, iv
        bending, couple = self.bending_forces()  # v
        weight = self.mass[:, None] * np.array(self.sc.gravity)
        loads = springs + weight
        loads[-1] += magnetic
        along = dot(loads + bending, self.t) + couple  # vii
        if self.sc.coupling == "wrench":
            along[-1] += self.sc.tip.moment * self.bend[-1] @ field
        normal = np.linalg.norm(loads - dot(loads, self.t)[:, None] * self.t, axis=1)
        contact = self.sc.contact
        if contact.lever_friction:  # two contacts a lever apart bear the tip's couple
            normal[-1] += 2 * np.linalg.norm(np.cross(self.sc.tip.moment * self.t[-1], field)) / contact.lever
        friction = -contact.friction * normal * self.v / np.sqrt(self.v**2 + contact.stick_speed**2)
        kick = self.h if self.time else 0.5 * self.h  # speeds stand half a step before the positions (leapfrog)
        self.v = self.v + kick * (along + friction - self.drag * self.v) / self.mass  # ii, vi
        moved = self.x + self.h * self.v[:, None] * self.t  # viii
        self.u = self.spline.closest(moved, self.u)  # ix
        self.x, self.t, self.bend = self.spline.frame(self.u)
        self.time += self.h

    def magnetic_force(self) -> tuple[np.ndarray, np.ndarray]:
        """Force on the tip dipole and field there: the formulas of Section III-A, summed over the turned magnet."""
        s, c = np.sin(self.angle(self.time)), np.cos(self.angle(self.time))
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        d = self.x[-1] - self.centre - self.cloud.positions @ turn.T
        m1, m2 = self.cloud.moments @ turn.T, self.sc.tip.moment * self.t[-1]
        r = np.linalg.norm(d, axis=1)[:, None]
        n1, n2 = dot(m1, d)[:, None], (d @ m2)[:, None]
        force = 3 * MU0 / (4 * np.pi * r**5) * (n1 * m2 + n2 * m1 + (m1 @ m2)[:, None] * d - 5 / r**2 * n1 * n2 * d)
        field = MU0 / (4 * np.pi) * (3 * d / r**5 * n1 - m1 / r**3)
        return force.sum(axis=0), field.sum(axis=0)

    def spring_forces(self) -> np.ndarray:
        """Each segment pulls its ends together by k times what its chord exceeds the rest length."""
        chord = np.diff(self.x, axis=0)
        stretch = np.linalg.norm(chord, axis=1) - self.sc.wire.segment_length
        pull = self.sc.wire.axial_spring * stretch[:, None] * unit(chord)
        force = np.zeros_like(self.x)
        force[:-1] += pull
        force[1:] -= pull
        return force

    def bending_forces(self) -> tuple[np.ndarray, np.ndarray]:
        """Forces of the joints' energy ½ k φ², and what the end cells' couples do along the tract.

        A joint turns its two segments towards each other. Half a cell stands at either end, twice as stiff, between
        the end segment and the tract's tangent: it turns the segment to the tangent, and, since the tangent turns as
        the end slides, drives the end by k φ times the rate at which sliding closes the angle.
        """
        k, force, couple = self.sc.wire.bending_spring, np.zeros_like(self.x), np.zeros(len(self.x))
        chord = np.diff(self.x, axis=0)
        length, u = np.linalg.norm(chord, axis=1)[:, None], unit(chord)
        phi, to_upper, to_lower = self.angle_between(u[:-1], u[1:])
        self.turn_segments(force[:-2], force[1:-1], k * phi * to_upper / length[:-1])
        self.turn_segments(force[1:-1], force[2:], k * phi * to_lower / length[1:])
        for end, segment, pair in ((0, 0, slice(0, 2)), (-1, -1, slice(-2, None))):
            phi, to_tangent, to_segment = self.angle_between(u[segment][None], self.t[end][None])
            lower, upper = force[pair][:1], force[pair][1:]
            self.turn_segments(lower, upper, 2 * k * phi * to_tangent / length[segment])
            couple[end] = 2 * k * phi[0, 0] * to_segment[0] @ self.bend[end]
        return force, couple

    @staticmethod
    def angle_between(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The angle (n, 1), the unit normal to a that turns a towards b, and the one to b that turns b towards a."""
        cos, sin = dot(a, b)[:, None], np.linalg.norm(np.cross(a, b), axis=1)[:, None]
        safe = np.where(sin > 1e-12, sin, 1.0)
        bent = sin > 1e-12
        return np.arctan2(sin, cos), bent * (b - cos * a) / safe, bent * (a - cos * b) / safe

    @staticmethod
    def turn_segments(lower: np.ndarray, upper: np.ndarray, push: np.ndarray) -> None:
        """A couple on segments: `push` on their upper ends, the opposite on their lower."""
        upper += push
        lower -= push
