"""Where every number of a block of lanes stands: ``array[item * STRIDE + FIELD + lane]``, a field is `LANES` numbers.

The arrays of a block, and what an item of each is:

par    what a lane is given and does not change by itself       the lane
wire   the wire's properties                                    a node; a segment goes with its lower node
lane   what changes as a lane moves, beside its nodes           the lane
node   positions and velocities                                 a node
spin   directors of the segments, for wires that twist          a node
foot   where on the wall's centreline a contact point stands    a contact point
work   a thread's workspace; nothing in it outlives a period    a node
"""

from __future__ import annotations

from ..lanes import LANES

HELD = 1e30
"""Stiffness, N/m, that holds a coordinate where it is: added to the diagonal, it leaves nothing of the correction."""

FINEST = 64
"""Parts into which the longest step may be halved."""

TABLE_STRIDE = 24
"""Numbers in a row of the lumen's table: three cubics of the centreline, one of the radius (4 each), then LEAST, MOST
(limits of the way along the row), BEFORE, AFTER (how many rows on its neighbours are, 0 for none), and four spare."""


def _fields(names: str, stride: int = LANES) -> list[int]:
    return [i * stride for i in range(len(names.split()))]


# GX … : gravity, m/s²
# STEP : s, the longest step; STEPS : such steps in a control period
# FRICTION, STICK : Coulomb's coefficient and the speed that smooths it, m/s
# WALL : N/m² a metre of wire and of penetration; TIP_CAP : m of wire that the tip's end stands for
# MOST_MOVE : m that a node may move between two evaluations
# FORCE_TOLERANCE N, MOVE_TOLERANCE m : a step has converged when the forces balance to the one, or when the next
#     correction is below the other
# PATIENCE : evaluations of a step before it is halved
# MEMORY : 1; 0 for a wire that forgets its speed after every step, to relax
# BASE_X … BASE_TZ : the inlet, or the clamp at the base, and its direction; TIP_TX … that of a clamp at the tip
# BASE_CLAMPED, TIP_CLAMPED, FED : 1 or 0
# FEED_SPEED m/s, FEED_STIFFNESS N/m, FEED_FORCE N : of the drive; TWIST_SPEED rad/s
# SPACING : m of centreline a row of the lumen's table; INLET_ROW : the row at whose start the inlet is
# GRID_X … GRID_AT : the wall's bricks: corner m, bricks along each axis, cell m, and where the data begin;
#     GRID_INLET : m, radius of the tube that goes on straight behind the inlet, beyond the bricks
# FIELD_X … : a uniform field, T, beside the rig's
_PAR = """GX GY GZ STEP STEPS FRICTION STICK WALL TIP_CAP MOST_MOVE FORCE_TOLERANCE MOVE_TOLERANCE PATIENCE MEMORY
BASE_X BASE_Y BASE_Z BASE_TX BASE_TY BASE_TZ TIP_TX TIP_TY TIP_TZ BASE_CLAMPED TIP_CLAMPED FED
FEED_SPEED FEED_STIFFNESS FEED_FORCE TWIST_SPEED SPACING FIELD_X FIELD_Y FIELD_Z INLET_ROW
GRID_X GRID_Y GRID_Z GRID_NX GRID_NY GRID_NZ GRID_CELL GRID_AT GRID_INLET"""
(
    GX, GY, GZ, STEP, STEPS, FRICTION, STICK, WALL, TIP_CAP, MOST_MOVE, FORCE_TOLERANCE, MOVE_TOLERANCE, PATIENCE,
    MEMORY, BASE_X, BASE_Y, BASE_Z, BASE_TX, BASE_TY, BASE_TZ, TIP_TX, TIP_TY, TIP_TZ, BASE_CLAMPED, TIP_CLAMPED, FED,
    FEED_SPEED, FEED_STIFFNESS, FEED_FORCE, TWIST_SPEED, SPACING, FIELD_X, FIELD_Y, FIELD_Z, INLET_ROW,
    GRID_X, GRID_Y, GRID_Z, GRID_NX, GRID_NY, GRID_NZ, GRID_CELL, GRID_AT, GRID_INLET,
) = _fields(_PAR)  # fmt: skip
PAR_SIZE = len(_PAR.split()) * LANES

# MASS kg, DRAG N·s/m of the node; HOLD_X … `HELD` or 0; FORCE_X … : dead load, N; BENDING E I, TWISTING G J (N·m²) and
# natural curvature CURL_1, CURL_2 (1/m) of its joint; REST m, AXIAL E A (N), RADIUS m, MOMENT A·m² of the segment above
# it, and AT, where along that the moment feels the field (0 to 1); SPIN_INERTIA kg·m² of the segment
_WIRE = """MASS DRAG HOLD_X HOLD_Y HOLD_Z FORCE_X FORCE_Y FORCE_Z BENDING TWISTING CURL_1 CURL_2
REST AXIAL RADIUS MOMENT AT SPIN_INERTIA"""
(
    MASS, DRAG, HOLD_X, HOLD_Y, HOLD_Z, FORCE_X, FORCE_Y, FORCE_Z, BENDING, TWISTING, CURL_1, CURL_2,
    REST, AXIAL, RADIUS, MOMENT, AT, SPIN_INERTIA,
) = _fields(_WIRE)  # fmt: skip
WIRE_STRIDE = len(_WIRE.split()) * LANES

# FIRST : the first node outside the sleeve (0 for a wire that is not fed)
# CELL : rest length of the segment above it, m (CELL_REST when whole), with its length at the step's start, speed,
#     direction of search; OUT : m of wire above the cell; FEED_GOAL : where the drive wants the cell, FEED_START at the
#     step's start; FEED_WANT, TWIST_WANT : commands, m and rad
# LEFT, LENGTH : of the period and of the step, in FINEST parts of the longest step; H : the step, s
# ENERGY, SLOPE, ALPHA : of the search along MOVE; TRIES : evaluations of this step; TAKEN, EXACT : 1 or 0
# SPUN, SPUN_START : rad the base has been turned; BASE_MX … TIP_MZ : directors of the clamps
# Over the last period: FAILED steps, EVALUATED potentials, STEPPED steps, RESIDUAL N at most, SUM_WALL N (times the
#     steps), PEAK_WALL N, of the wall's normal forces
# BASE_FX … BASE_TQZ : what the base exerts on the wire, N and N·m; ENDED : 1 where a step has just ended
# FORESEES : which direction is wanted of an evaluation, see `stepper`; REBUILT : how often this iterate was evaluated
#     once more; BEFORE : m, the largest part of the last full step
_LANE = """FIRST CELL CELL_REST CELL_START CELL_SPEED CELL_MOVE OUT FEED_GOAL FEED_START FEED_WANT TWIST_WANT
LEFT LENGTH H
ENERGY SLOPE ALPHA TRIES TAKEN EXACT SPUN SPUN_START BASE_MX BASE_MY BASE_MZ TIP_MX TIP_MY TIP_MZ
FAILED EVALUATED STEPPED RESIDUAL SUM_WALL PEAK_WALL BASE_FX BASE_FY BASE_FZ BASE_TQX BASE_TQY BASE_TQZ ENDED
FORESEES REBUILT BEFORE"""
(
    FIRST, CELL, CELL_REST, CELL_START, CELL_SPEED, CELL_MOVE, OUT, FEED_GOAL, FEED_START, FEED_WANT, TWIST_WANT,
    LEFT, LENGTH, H,
    ENERGY, SLOPE, ALPHA, TRIES, TAKEN, EXACT, SPUN, SPUN_START, BASE_MX, BASE_MY, BASE_MZ, TIP_MX, TIP_MY, TIP_MZ,
    FAILED, EVALUATED, STEPPED, RESIDUAL, SUM_WALL, PEAK_WALL, BASE_FX, BASE_FY, BASE_FZ, BASE_TQX, BASE_TQY, BASE_TQZ,
    ENDED, FORESEES, REBUILT, BEFORE,
) = _fields(_LANE)  # fmt: skip
LANE_SIZE = len(_LANE.split()) * LANES

# X … : the iterate, m; VX … : velocity at the step's start, m/s
_NODE = "X Y Z VX VY VZ"
X, Y, Z, VX, VY, VZ = _fields(_NODE)
NODE_STRIDE = len(_NODE.split()) * LANES

# MX … : the segment's director; RATE : its spin, rad/s
_SPIN = "MX MY MZ RATE"
MX, MY, MZ, RATE = _fields(_SPIN)
SPIN_STRIDE = len(_SPIN.split()) * LANES

# ROW, ALONG : the row of the table and the way along it, m
_FOOT = "ROW ALONG"
ROW, ALONG = _fields(_FOOT)
FOOT_STRIDE = len(_FOOT.split()) * LANES

# Of a node in the workspace. START : its place at the step's start; MOVE : the direction it is tried along; GRADIENT of
# the potential; CONTACT : the wall's force on it; RIGHT, W1, W2 : its rows of the elimination.
START, MOVE, GRADIENT, CONTACT, RIGHT, W1, W2 = (i * LANES for i in (0, 3, 6, 9, 12, 15, 24))
# Of its segment, for wires that twist. N0 : director at the step's start, M1 : on trial; TURN : spin since the step's
# start, TURN_MOVE : its direction; SPIN_GRADIENT of the potential; U1, U2 : the node's row by the spins of its segment
# and the next; SPIN_RIGHT, S1, S2, S3 : the spin's own row.
N0, M1, TURN, TURN_MOVE, SPIN_GRADIENT, U1, U2, SPIN_RIGHT, S1, S2, S3 = (
    i * LANES for i in (33, 36, 39, 40, 41, 42, 45, 48, 49, 52, 55)
)  # fmt: skip
WORK_STRIDE = 56 * LANES

MARKS = 8
"""Numbers of a mark: the tip's place, that of the node before it, and the row and the way along it of the tip's foot;
the rig's degrees of freedom follow."""

# Of a contact point in the workspace: its load and its normal, for friction, as lagged and as found, and the iterate's
# foot.
LAGGED, FOUND, KEPT = 0, 4 * LANES, 8 * LANES
LOAD_STRIDE = 10 * LANES
