"""A trained policy that looks at an image, as plain arrays: convolutions by NumPy alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..observations import rows, shapes
from .plain_policy import ACTIVATIONS, PRODUCTS, Layer, Normalization, PlainPolicy, PolicyAbout

__all__ = ["Convolution", "Eyes", "SeeingPolicy"]

_AT_A_TIME = 16
"""Images whose patches are laid out together: it bounds the memory."""


@dataclass(frozen=True, eq=False)
class Convolution:
    """A convolution without padding, in single precision: a layer upon every patch of the image.

    weight : (outputs, inputs, k, k); bias : (outputs,)
    stride : px from one patch to the next
    activation, parameters : as `Layer`'s
    """

    weight: np.ndarray
    bias: np.ndarray
    stride: int
    activation: str = "identity"
    parameters: tuple[float, ...] = ()

    def size(self, side: int) -> int:
        """Rows of what comes out of an image of `side` rows; less than 1 where no patch fits in."""
        return (side - self.weight.shape[2]) // self.stride + 1

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """image (n, inputs, h, w) → (n, outputs, …)."""
        outputs, inputs, k, _ = self.weight.shape
        patches = np.lib.stride_tricks.sliding_window_view(image, (k, k), axis=(2, 3))  # type: ignore[call-overload]
        patches = patches[:, :, :: self.stride, :: self.stride].transpose(0, 2, 3, 1, 4, 5)
        n, h, w = patches.shape[:3]
        y = _product(patches.reshape(n * h * w, inputs * k * k), self.weight.reshape(outputs, -1).T)
        y += self.bias
        run = ACTIVATIONS[self.activation][0]
        if run is not None:
            run(y, *self.parameters)
        return y.reshape(n, h, w, outputs).transpose(0, 3, 1, 2)


class Eyes:
    """Image → features: convolutions, then a layer upon all that comes out of them.

    shape : (channels, h, w) of the image, with all the frames that are seen together
    """

    def __init__(self, shape: tuple[int, int, int], convolutions: Sequence[Convolution], layer: Layer) -> None:
        self.shape, self.convolutions, self.layer = shape, tuple(convolutions), layer

    @property
    def features(self) -> int:
        """How many numbers come out."""
        return len(self.layer.bias)

    @staticmethod
    def flat(shape: tuple[int, int, int], convolutions: Sequence[Convolution]) -> int:
        """How many numbers enter the layer, of an image of this shape; 0 where the image is too small."""
        channels, h, w = shape
        for one in convolutions:
            channels, h, w = len(one.bias), one.size(h), one.size(w)
            if h < 1 or w < 1:
                return 0
        return channels * h * w

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """image (n, channels, h, w) uint8 → (n, features)."""
        count, out = max(1, PRODUCTS // self.layer.weight.size), []
        for i in range(0, len(image), _AT_A_TIME):
            x = image[i : i + _AT_A_TIME].astype(np.float32) / np.float32(255.0)
            for one in self.convolutions:
                x = one(x)
            x = x.reshape(len(x), -1)
            out += [self.layer(x[j : j + count]) for j in range(0, len(x), count)]
        return np.concatenate(out)


class SeeingPolicy(PlainPolicy):
    """As `PlainPolicy`, on observations with an image: its features enter the network, and the numbers after them.

    eyes : what looks at the image, with all frames that are seen together
    normalization : of the numbers, or None
    """

    def __init__(
        self,
        eyes: Eyes,
        layers: Sequence[Layer],
        normalization: Normalization | None,
        low: np.ndarray,
        high: np.ndarray,
        squashed: bool,
        frames: int,
        about: PolicyAbout,
    ) -> None:
        super().__init__(layers, normalization, low, high, squashed, frames, about)
        self.eyes = eyes
        self.size = (len(layers[0].weight) - eyes.features) // frames

    @property
    def image(self) -> tuple[int, int, int]:
        channels, h, w = self.eyes.shape
        return channels // self.frames, h, w

    @property
    def sees(self) -> str:
        image = "an image of {1} × {2} px".format(*self.image)
        return f"{image} and {super().sees}" if self.size else image

    @property
    def form(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the parts of one observation of the env."""
        return {"image": self.image} | ({"state": (self.size,)} if self.size else {})

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """As SB3's: image (channels, h, w) and state (size,), or n of each → action (k,) or (n, k), and the state.

        Raises `ValueError` for an observation of another form, or `deterministic=False`: only the mean action is kept.
        """
        if not deterministic:
            raise ValueError("deterministic must be True for a saved policy, which keeps no exploration noise")
        self._check(observation)
        batch, many = rows(observation)
        if self.frames > 1:
            batch = state = self._with_frames(batch, state, episode_start)
        action = self.act(batch)
        return (action if many else action[0]), state

    def act(self, batch: Mapping[str, np.ndarray]) -> np.ndarray:
        """The actions for a batch whose parts hold all frames."""
        x = self.eyes(batch["image"])
        if self.size:
            seen = batch["state"]
            numbers = seen.astype(np.float32) if self.normalization is None else self.normalization(seen)
            x = np.concatenate([x, numbers], axis=1)
        parts = [self._network(x[i : i + self._rows]) for i in range(0, len(x), self._rows)]
        return np.concatenate(parts)

    def _check(self, observation: Any) -> None:
        form = self.form
        fits = isinstance(observation, Mapping) and set(observation) == set(form)
        if fits:
            ways = {np.ndim(observation[name]) - len(shape) for name, shape in form.items()}
            ends = all(np.shape(observation[name])[-len(shape) :] == shape for name, shape in form.items())
            fits = ends and ways in ({0}, {1})
        if not fits:
            raise ValueError(
                f"observation must be a dict of {shapes_of(form)}, or n of each, got {shapes(observation)}"
            )

    def _with_frames(self, batch: dict[str, np.ndarray], kept: Any, starts: np.ndarray | None) -> dict[str, np.ndarray]:
        """The last frames of each part with the newest; nothing but the newest where an episode starts."""
        out = {}
        for name, x in batch.items():
            size = x.shape[1]
            if kept is None:
                frames = np.zeros((len(x), self.frames * size, *x.shape[2:]), dtype=x.dtype)
            else:
                frames = kept[name].copy()
                if starts is not None:
                    frames[np.reshape(starts, -1)] = 0
            out[name] = np.concatenate([frames[:, size:], x], axis=1)
        return out


def shapes_of(form: Mapping[str, tuple[int, ...]]) -> str:
    """For people: the parts of an observation, each with its shape."""
    return ", ".join(f"{name} {shape}" for name, shape in form.items())


def _product(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """x @ weight, in parts so small that none is shared out over threads."""
    weight = np.ascontiguousarray(weight)
    count = max(1, PRODUCTS // weight.size)
    out = np.empty((len(x), weight.shape[1]), dtype=np.float32)
    for i in range(0, len(x), count):
        np.matmul(x[i : i + count], weight, out=out[i : i + count])
    return out
