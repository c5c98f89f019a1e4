"""The scenes moved by MuJoCo's cable. Imported only where the package is installed, in a version that has the cable."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from .cylinder import Cylinder
from .tube import Found, Helix

__all__ = ["coiled", "drawn_round"]

if int(mujoco.__version__.partition(".")[0]) >= 4:
    raise ImportError(f"MuJoCo {mujoco.__version__} has no cable any more, install mujoco<4")

THIN = 2e-3
"""m, radius of the capsules round the cylinder, so that friction has no lever about the centreline."""


def cable(
    rest: np.ndarray, radius: float, bending: float, mass: float, damping: float, armature: float, geom: str
) -> str:
    """A cable along +x from the origin of its parent, straight at rest, hung on a ball joint.

    rest : (n,) m; radius : m; bending : N·m²; mass : kg/m; damping : N·m·s/rad and armature : kg·m², of each joint
    geom : further attributes of its capsules
    """
    ends = " ".join(f"{x:.12g} 0 0" for x in np.concatenate([[0.0], np.cumsum(rest)]))
    modulus = bending / (math.pi * radius**4 / 4)
    density = mass / (math.pi * radius**2)
    return f"""
      <composite type="cable" initial="ball" vertex="{ends}">
        <plugin plugin="mujoco.elasticity.cable">
          <config key="twist" value="{modulus / 3:.12g}"/><config key="bend" value="{modulus:.12g}"/>
          <config key="flat" value="true"/>
        </plugin>
        <joint kind="main" damping="{damping:g}" armature="{armature:g}"/>
        <geom type="capsule" size="{radius:g}" density="{density:.12g}" {geom}/>
      </composite>"""


def turns_of(positions: np.ndarray) -> np.ndarray:
    """(4 n,) quaternions of the ball joints that lay a straight cable along +x through positions (n + 1, 3)."""
    t = np.diff(positions, axis=0)
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    found, frame = [], np.array([1.0, 0.0, 0.0, 0.0])
    for way in t:
        own = np.empty(3)
        mujoco.mju_rotVecQuat(own, way, _inverse(frame))
        turn = _between(np.array([1.0, 0.0, 0.0]), own)
        found.append(turn)
        after = np.empty(4)
        mujoco.mju_mulQuat(after, frame, turn)
        frame = after
    return np.concatenate(found)


def _inverse(q: np.ndarray) -> np.ndarray:
    return q * [1.0, -1.0, -1.0, -1.0]


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The least turn from unit vector a to b; they must not be opposite."""
    q = np.concatenate([[1.0 + a @ b], np.cross(a, b)])
    if q[0] < 1e-9:
        raise ValueError("the cable must not start against +x")
    return q / np.linalg.norm(q)


def pulled_at_the_end(data: Any, model: Any, force: np.ndarray, length: float) -> None:
    """Put `force` (3,) N on the end of the last segment, whose length is `length` m."""
    last = model.body("B_last").id
    point = data.xpos[last] + length * data.xmat[last].reshape(3, 3)[:, 0]
    data.qfrc_applied[:] = 0.0
    mujoco.mj_applyFT(model, data, force, np.zeros(3), point, last, data.qfrc_applied)


def drawn_round(scene: Cylinder, step: float, damping: float = 1e-2, armature: float = 1e-3) -> float:
    """T2/T1 over the last fifth of the travel. step : s; damping, armature : see `cable`."""
    rest, start = scene.rest[::-1], scene.start[::-1]
    soft = f'solref="{2.0 * step:g} 1" solimp="0.99 0.99 0.001" friction="{scene.friction:g} 0 0"'
    far = " ".join(f"{x:.12g}" for x in start[0])
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <extension><plugin plugin="mujoco.elasticity.cable"/></extension>
      <compiler autolimits="true"/>
      <option gravity="0 0 0" timestep="{step:g}" integrator="implicitfast" cone="elliptic" impratio="10"
        tolerance="1e-10"/>
      <worldbody>
        <geom name="cylinder" type="cylinder" size="{scene.radius - THIN:g} 1" contype="1" conaffinity="2" {soft}/>
        <body name="cart" pos="{far}">
          <inertial pos="0 0 0" mass="0.001" diaginertia="1e-6 1e-6 1e-6"/>
          <joint name="along" type="slide" axis="0 1 0"/><joint type="slide" axis="1 0 0"/>
          {cable(rest, THIN, scene.bending, scene.mass, damping, armature, 'contype="2" conaffinity="1" ' + soft)}
        </body>
      </worldbody>
      <actuator><velocity joint="along" kv="1e3"/></actuator>
    </mujoco>""")  # fmt: skip
    data = mujoco.MjData(model)
    data.qpos[2:] = turns_of(start)
    mujoco.mj_forward(model, data)
    pulls, steps = [], round(scene.travel / (scene.speed * step))
    force = scene.pull * scene.directions[0]
    for k in range(steps):
        data.ctrl[0] = -scene.speed * min(k * step / 0.1, 1.0)
        pulled_at_the_end(data, model, force, rest[-1])
        mujoco.mj_step(model, data)
        if k >= 0.8 * steps:
            pulls.append(-data.actuator_force[0])
    if data.warning.number.any() or not np.isfinite(pulls).all():
        raise RuntimeError("the cable has blown up")
    return float(np.mean(pulls)) / scene.pull


def staves(inner: float, length: float, count: int, attributes: str) -> str:
    """A tube about the x axis of `count` flat boxes, since concave walls must be made of convex parts.

    inner : m, from the axis to each box; length : m, from x = −length/10 on
    """
    thick, half = inner, 0.6 * length
    width = inner * math.tan(math.pi / count)
    parts = []
    for k in range(count):
        angle = 2 * math.pi * k / count
        away = inner + thick
        place = f"{0.5 * length:.12g} {away * math.cos(angle):.12g} {away * math.sin(angle):.12g}"
        turn = f"{math.cos(0.5 * angle):.12g} {math.sin(0.5 * angle):.12g} 0 0"
        size = f"{half:.12g} {thick:.12g} {width:.12g}"
        parts.append(f'<geom type="box" size="{size}" pos="{place}" quat="{turn}" {attributes}/>')
    return "\n".join(parts)


def coiled(scene: Helix, step: float, armature: float = 1e-10, count: int = 48) -> Found:
    """The settled helix. step : s; armature : kg·m² of each joint; count : flat walls of the tube."""
    stiff = scene.bending / float(scene.rest[0])
    soft = f'solref="{2.0 * step:g} 1" solimp="0.99 0.99 0.001" condim="1"'
    tube = staves(scene.gap + scene.radius, scene.length, count, f'contype="1" conaffinity="2" {soft}')
    wire = cable(
        scene.rest, scene.radius, scene.bending, scene.mass, 1e-3 * stiff, armature,
        f'contype="2" conaffinity="1" {soft}',
    )  # fmt: skip
    base = " ".join(f"{x:.12g}" for x in scene.start[0])
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <extension><plugin plugin="mujoco.elasticity.cable"/></extension>
      <option gravity="0 0 0" timestep="{step:g}" integrator="implicitfast" tolerance="1e-12"/>
      <worldbody>
        {tube}
        <body name="cart" pos="{base}">
          <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-13 1e-13 1e-13"/>
          <joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
          {wire}
        </body>
      </worldbody>
    </mujoco>""")
    data = mujoco.MjData(model)
    data.qpos[2:] = turns_of(scene.start)
    mujoco.mj_forward(model, data)
    first, n = model.body("B_first").id, scene.segments
    steps, places, pressed = round(scene.seconds / step), [], []
    force, one = np.array([-scene.thrust, 0.0, 0.0]), np.empty(6)
    for k in range(steps):
        pulled_at_the_end(data, model, force, float(scene.rest[-1]))
        mujoco.mj_step(model, data)
        if k >= 0.8 * steps and k % 10 == 0:
            loads = np.zeros(n + 1)
            for i in range(data.ncon):
                mujoco.mj_contactForce(model, data, i, one)
                segment = int(model.geom_bodyid[data.contact.geom[i].max()]) - first
                loads[segment : segment + 2] += 0.5 * one[0]
            last = data.xpos[-1] + float(scene.rest[-1]) * data.xmat[-1].reshape(3, 3)[:, 0]
            places.append(np.vstack([data.xpos[first:], last]))
            pressed.append(loads)
    if data.warning.number.any() or not np.isfinite(places).all():
        raise RuntimeError("the cable has blown up")
    return scene.measured(np.mean(places, axis=0), np.mean(pressed, axis=0))
