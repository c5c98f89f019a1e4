"""What every wire model says about its wires: the contract between the simulator and everything above it.

`Simulator.readout` is one array of these rows over the lanes. A model fills them after every control period and
whenever a state was set from outside; environments, controllers and pictures read them and never a model's own arrays.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["OF_STATE", "ROW", "Readout"]


class Readout(NamedTuple):
    """Row numbers of `Simulator.readout`, SI units. Those of the present state come first.

    force_x … force_z : N, magnetic force on the tip
    field_x … field_z : T, flux density at the tip
    drive : N, the magnets' generalised force along the tip's way
    lateral : N, size of the magnetic force across that way
    torque : N·m, size of the magnetic torque on the tip
    wall : N, force on the wall; each model's docstring says which
    tip_x … tip_z : m
    tangent_x … tangent_z : direction of the tip's moment, of length 1 to 1e-5
    speed : m/s, of the tip along its way
    travelled : m, way from the inlet to the tip along the route
    remaining : m, way left along the route to the goal; negative once past it
    base_force_x … base_force_z : N, what holds the wire's base; 0 where nothing does
    base_torque_x … base_torque_z : N·m, the same
    inserted : m of wire inside the lumen; 0 of a model without a base
    branch : number of the lumen's branch that the tip is in; 0 of a model without branches
    astray : m from the tip back to the route to the goal; 0 upon it
    peak_lateral, peak_wall : N, largest over the substeps of the last control period
    mean_wall : N, mean over those substeps
    travel : rad and m summed, how far the rig moved in the last control period
    unconverged : substeps of the last control period whose motion is not to be trusted: whose solve did not converge,
        one more if nodes passed each other, and all of them where the step given is too long for the wire
    """

    force_x: int
    force_y: int
    force_z: int
    field_x: int
    field_y: int
    field_z: int
    drive: int
    lateral: int
    torque: int
    wall: int
    tip_x: int
    tip_y: int
    tip_z: int
    tangent_x: int
    tangent_y: int
    tangent_z: int
    speed: int
    travelled: int
    remaining: int
    base_force_x: int
    base_force_y: int
    base_force_z: int
    base_torque_x: int
    base_torque_y: int
    base_torque_z: int
    inserted: int
    branch: int
    astray: int
    peak_lateral: int
    peak_wall: int
    mean_wall: int
    travel: int
    unconverged: int


ROW = Readout(*range(len(Readout._fields)))

OF_STATE = ROW.peak_lateral
"""Rows below this number belong to the present state, the others to the last control period."""
