"""What a wire model must offer, and which models there are.

The simulator owns what all models share: the rig's arrays, the readout, the trace of the way left, time. A model owns
its wires. Nobody above the simulator knows which model runs: what only one of them has (certificates, force maps), a
model declares in `supports`, and code that needs it refuses the others by name (`require`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from ..physics.checks import one_of
from ..scenario import Scenario

if TYPE_CHECKING:
    from .library import Library
    from .rig_arrays import RigLanes

__all__ = ["FEATURES", "Places", "WireModel", "model_class", "model_names", "register_model", "require", "supports"]

FEATURES = {
    "quasistatic": "a quasi-static theory along one centreline: certificates, force maps, best commands, the par",
    "arclength": "nodes that are arc lengths of one centreline",
    "vary": "friction and stiffness that change from episode to episode",
    "base": "a base that can be fed and turned",
    "profiles": "properties that change along the wire",
    "branches": "a lumen that branches, or with a wall of its own",
    "contact": "contact forces node by node",
}
"""What a model may support, by name."""


class Places:
    """Places in a lumen, one a lane: a branch, and an arc length along it from the branch's start.

    branch : (n,) whole numbers into the lumen's branches
    s : (n,) m
    """

    def __init__(self, s: np.ndarray | Sequence[float] | float, branch: np.ndarray | int = 0) -> None:
        self.s = np.asarray(s, dtype=np.float64).reshape(-1)
        self.branch = np.zeros(self.s.shape, dtype=np.int64)
        if isinstance(branch, np.ndarray) or branch:  # else all are in the trunk
            self.branch[:] = branch

    def __len__(self) -> int:
        return len(self.s)

    def __getitem__(self, rows: Any) -> Places:
        return Places(self.s[rows], self.branch[rows])


class WireModel(Protocol):
    """The wires of a batch. Lanes are numbers (n,) below `num_envs`; entries are numbers into the scenarios.

    name : the scenario's `model`
    supports : of `FEATURES`
    nodes : of the batch's longest wire
    columns : which columns of the opaque block that `read` gives hold what
    """

    name: ClassVar[str]
    supports: ClassVar[frozenset[str]]
    nodes: int
    columns: Mapping[str, slice]

    def __init__(
        self,
        library: Library,
        rig: RigLanes,
        readout: np.ndarray,
        trace: np.ndarray,
        threads: int | None,
    ) -> None:
        """Make room for the wires of as many lanes as `rig` has.

        library : the scenarios; its `wires` is what `library` of this class made of them
        readout : (rows, lanes), which `step` and `refresh` fill, see `magwire_env.simulation.readout`
        trace : (substeps + 1, lanes) m, way left to the goal through a control period, which `step` fills
        """

    @staticmethod
    def library(scenarios: Sequence[Scenario]) -> Any:
        """The scenarios' wires as rows of numbers, which all batches of the same scenarios share."""

    def take(self, lanes: np.ndarray, entries: np.ndarray) -> None:
        """Give `lanes` the wires of the scenarios `entries`."""

    def vary(self, lanes: np.ndarray, factors: Mapping[str, np.ndarray]) -> None:
        """Scale what `take` gave `lanes` by factors (n,): "friction", "stiffness"."""

    def start(self, entries: np.ndarray) -> Places:
        """Where the tip of a wire stands that lies just inside the inlet."""

    def lay(self, lanes: np.ndarray, places: Places) -> None:
        """Wires of `lanes` at rest with their tips at `places`; the simulator refreshes afterwards.

        A model with a base puts the rig's feed and twist to where this leaves them. Raises `ValueError`, before
        anything changes, for places where its wires cannot be.
        """

    def set_goal(self, lanes: np.ndarray, places: Places) -> None:
        """From now on the way left of `lanes` counts to `places`."""

    def step(self) -> None:
        """Move every lane through one control period under ``rig.command``, and fill the readout and the trace."""

    def refresh(self, lanes: np.ndarray) -> None:
        """Fill the readout's rows of the present state."""

    def read(self, lanes: np.ndarray) -> np.ndarray:
        """A copy of the wires' state, (n, columns)."""

    def write(self, lanes: np.ndarray, wire: np.ndarray) -> None:
        """Put a state back; the simulator refreshes afterwards."""

    def positions(self, lanes: np.ndarray) -> np.ndarray:
        """(n, nodes, 3) m, base to tip; NaN where a lane has fewer nodes than the batch's longest wire."""

    def node_contact(self, lanes: np.ndarray) -> np.ndarray:
        """(n, nodes, 3) N, what the wall exerts on every node."""

    def route_length(self, lanes: np.ndarray) -> np.ndarray:
        """(n,) m, from the inlet along the route to its end: what lengths along the route are measured against."""

    def ahead(self, offsets: np.ndarray) -> np.ndarray:
        """The route's centreline `offsets` (k,) m ahead of every tip: points, tangents, curvature, (n, k, 9)."""


BUILT_IN = ("locked", "free")

_MODELS: dict[str, str | Callable[..., WireModel]] = {
    "locked": "magwire_env.simulation.locked.arrays:LockedWires",
    "free": "magwire_env.simulation.free.arrays:FreeModel",
}


def register_model(name: str, model: str | Callable[..., WireModel]) -> None:
    """Make a wire model of your own known: scenarios with ``model=name`` then run on it.

    model : a class that offers what `WireModel` lists, or "module:Class"
    """
    if name in BUILT_IN:
        raise ValueError(f"name must be of a model that does not exist yet, got {name!r}")
    _MODELS[name] = model


def model_names() -> tuple[str, ...]:
    """The models there are."""
    return tuple(_MODELS)


def model_class(name: str) -> Any:
    """The class of a model. Raises `ValueError` for a name that is not registered."""
    found = _MODELS[one_of("Scenario.model", name, model_names())]
    if isinstance(found, str):
        module, _, attribute = found.partition(":")
        return getattr(import_module(module), attribute)
    return found


def supports(scenario: Scenario, feature: str) -> bool:
    """Whether the scenario's wire model has `feature`, of `FEATURES`."""
    return feature in model_class(scenario.model).supports


def require(scenario: Scenario, feature: str, what: str) -> None:
    """Raise `ValueError` if the scenario's wire model does not support `feature`; `what` says who needs it."""
    if not supports(scenario, feature):
        raise ValueError(
            f"{what} needs {FEATURES[feature]}; Scenario.model must be one that has it, got {scenario.model!r}"
        )
