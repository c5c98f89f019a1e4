"""A trained policy as plain arrays, run by NumPy alone: no torch, no Stable-Baselines3, no pickle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from magwire_env.words import counted

__all__ = ["ACTIVATIONS", "PRODUCTS", "Layer", "Normalization", "PlainPolicy", "PolicyAbout"]

PRODUCTS = 1_000_000
"""Multiplications up to which a product of matrices stays in this thread. Larger ones are shared out by OpenBLAS, which
wins a third on an idle machine and waits up to 100 ms on a busy one."""


def _relu(x: np.ndarray) -> None:
    np.maximum(x, np.float32(0.0), out=x)


def _elu(x: np.ndarray, alpha: float) -> None:
    x[...] = np.where(x > 0, x, np.float32(alpha) * np.expm1(np.minimum(x, np.float32(0.0))))


def _leaky_relu(x: np.ndarray, slope: float) -> None:
    x[...] = np.where(x > 0, x, np.float32(slope) * x)


def _sigmoid(x: np.ndarray) -> None:
    # By way of tanh, which does not overflow.
    x *= np.float32(0.5)
    np.tanh(x, out=x)
    x += np.float32(1.0)
    x *= np.float32(0.5)


def _silu(x: np.ndarray) -> None:
    gate = x.copy()
    _sigmoid(gate)
    x *= gate


def _clip(x: np.ndarray, low: float, high: float) -> None:
    np.maximum(x, np.float32(low), out=x)
    np.minimum(x, np.float32(high), out=x)


ACTIVATIONS: dict[str, tuple[Callable[..., None] | None, int]] = {
    "identity": (None, 0),
    "tanh": (lambda x: np.tanh(x, out=x), 0),
    "relu": (_relu, 0),
    "elu": (_elu, 1),
    "leaky_relu": (_leaky_relu, 1),
    "silu": (_silu, 0),
    "sigmoid": (_sigmoid, 0),
    "clip": (_clip, 2),
}
"""Name → what changes an array in place, and how many numbers it takes."""


@dataclass(frozen=True, eq=False)
class Layer:
    """One layer, x ↦ activation(x W + b), in single precision.

    weight : (inputs, outputs); bias : (outputs,)
    activation : of `ACTIVATIONS`; parameters : the numbers it takes
    """

    weight: np.ndarray
    bias: np.ndarray
    activation: str = "identity"
    parameters: tuple[float, ...] = ()

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """x (…, inputs) → (…, outputs)."""
        y = x @ self.weight
        y += self.bias
        run = ACTIVATIONS[self.activation][0]
        if run is not None:
            run(y, *self.parameters)
        return y


@dataclass(frozen=True, eq=False)
class Normalization:
    """The observation's mean and standard deviation in training, (size,) each, in double precision, and the clip."""

    mean: np.ndarray
    std: np.ndarray
    clip: float

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """observation (…, size) → (observation − mean) / std within ±clip, in single precision."""
        x = observation.astype(np.float64)
        x -= self.mean
        x /= self.std
        x = x.astype(np.float32)
        np.maximum(x, np.float32(-self.clip), out=x)
        np.minimum(x, np.float32(self.clip), out=x)
        return x


@dataclass(frozen=True)
class PolicyAbout:
    """What a policy was trained for.

    task : id of a registered task
    env : keyword arguments of the env it was trained in, without the scenario
    scenario : that scenario as TOML text; None where the task draws one for every episode
    scenario_given : the scenario was asked for, and is not the task's own
    channels : names of the observation's channels
    """

    task: str
    algorithm: str
    seed: int
    timesteps: int
    env: dict[str, Any]
    scenario: str | None
    scenario_given: bool
    channels: tuple[str, ...]
    versions: dict[str, str]


class PlainPolicy:
    """A network with its normalisation that answers SB3's ``predict`` on the env's raw observations.

    layers : of the network, in order
    normalization : of what enters it, or None
    low, high : (k,) bounds of the action
    squashed : the network's output goes through tanh and is then stretched to the bounds; otherwise it is clipped
    frames : observations it sees together, the newest last; `predict` keeps them in its state
    about : what it was trained for
    """

    def __init__(
        self,
        layers: Sequence[Layer],
        normalization: Normalization | None,
        low: np.ndarray,
        high: np.ndarray,
        squashed: bool,
        frames: int,
        about: PolicyAbout,
    ) -> None:
        self.layers, self.normalization = tuple(layers), normalization
        self.low, self.high, self.squashed, self.frames, self.about = low, high, squashed, frames, about
        self.size = len(layers[0].weight) // frames
        """Numbers in one observation of the env."""
        self._half = np.float32(0.5) * (high - low)
        self._rows = max(1, PRODUCTS // max(layer.weight.size for layer in layers))

    @property
    def task(self) -> str:
        """Id of the task it was trained for."""
        return self.about.task

    @property
    def image(self) -> tuple[int, int, int] | None:
        """Shape of the image in one observation of the env, (channels, h, w); None of a policy that sees none."""
        return None

    @property
    def sees(self) -> str:
        """For people: what one observation of the env holds."""
        return f"{counted(self.size, 'number')} ({', '.join(self.about.channels)})"

    @property
    def env_settings(self) -> dict[str, Any]:
        """Keyword arguments of an env like the one it was trained in.

        Its scenario is among them where it is not what the task has by itself today.
        """
        from .scenario_copy import settings_with

        return settings_with(self.about.env, self.about.task, self.about.scenario, self.about.scenario_given)

    def misfit(self, env: Any) -> str:
        """Why it cannot play in an env or batch; "" if it sees there what it saw in training, and acts likewise."""
        from magwire_env.envs.task import TASKS

        core = getattr(env.unwrapped, "core", None)
        if core is None:
            return f"a policy of {self.task} needs a MagWire env, got {env}"
        taken = core.shown.fluoroscope
        image = None if taken is None else taken.space.shape
        seen = (tuple(core.observer.names), core.observer.space.shape, image)
        if seen != (self.about.channels, (self.size,), self.image):
            return (
                f"the policy was trained on {self.task} to see {self.sees}, but {core.task.id} shows {core.shown.text}"
            )
        mode = self.about.env.get("action_mode", TASKS[self.task].action_mode)
        if (core.actuation.mode, core.actuation.space.shape) != (mode, self.low.shape):
            return (
                f"the policy was trained on {self.task} to give {counted(len(self.low), 'number')} "
                f"(action_mode {mode!r}), but "
                f"{core.task.id} takes {core.actuation.space.shape[0]} here (action_mode {core.actuation.mode!r})"
            )
        return ""

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """As SB3's: observation (size,) or (n, size) → action (k,) or (n, k), and the state.

        Raises `ValueError` for an observation of another size, or `deterministic=False`: only the mean action is kept.
        """
        if not deterministic:
            raise ValueError("deterministic must be True for a saved policy, which keeps no exploration noise")
        x = np.asarray(observation)
        if x.ndim not in (1, 2) or x.shape[-1] != self.size:
            raise ValueError(
                f"observation must have shape ({self.size},) or (n, {self.size}), of the channels "
                f"{', '.join(self.about.channels)}; got {x.shape}"
            )
        if self.frames > 1:
            x = state = self._stacked(x, state, episode_start)
        if x.ndim == 1 or len(x) <= self._rows:
            return self.act(x), state
        return np.concatenate([self.act(x[i : i + self._rows]) for i in range(0, len(x), self._rows)]), state

    def act(self, x: Any) -> np.ndarray:
        """The actions for observations that hold all frames."""
        return self._network(x.astype(np.float32) if self.normalization is None else self.normalization(x))

    def _network(self, x: np.ndarray) -> np.ndarray:
        for layer in self.layers:
            x = layer(x)
        if self.squashed:
            return self.low + (np.tanh(x) + np.float32(1.0)) * self._half
        return np.minimum(np.maximum(x, self.low), self.high)

    def _stacked(self, x: np.ndarray, frames: np.ndarray | None, starts: np.ndarray | None) -> np.ndarray:
        """The last frames with the newest, (…, frames · size); nothing but the newest where an episode starts."""
        if frames is None:
            frames = np.zeros((*x.shape[:-1], self.frames * self.size), dtype=np.float32)
        elif starts is not None:
            frames = np.where(np.reshape(starts, x.shape[:-1])[..., None], np.float32(0.0), frames)
        return np.concatenate([frames[..., self.size :], x], axis=-1)
