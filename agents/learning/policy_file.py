"""Policies on disk as plain arrays: ``policy.safetensors`` holds numbers, ``policy.json`` says what they are.

Neither file can carry a program, so a stranger's policy may be opened. What can (Stable-Baselines3's ``model.zip`` and
every pickle) is opened by ``trust=True`` alone.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load as arrays_of
from safetensors.numpy import save as bytes_of

from magwire_env.words import counted

from ..notes import note
from ..shipped import folder_of
from .plain_eyes import Convolution, Eyes, SeeingPolicy
from .plain_policy import ACTIVATIONS, Layer, Normalization, PlainPolicy, PolicyAbout
from .run_folder import best_of
from .stored import Stored, read_json

__all__ = ["ARRAYS", "DESCRIPTION", "FORMAT", "load", "read", "write"]

ARRAYS, DESCRIPTION = "policy.safetensors", "policy.json"

FORMAT = 2
"""Of both files; goes up when an older program could not read them. Policies that see no image, and have weights in
single precision, are of format 1."""

_MOST_BYTES = 256 * 2**20
_LARGEST_IMAGE = 1024
_LARGEST_HALF = float(np.finfo(np.float16).max)
_PROGRAMS = (".pkl", ".pickle", ".zip", ".pt", ".pth", ".joblib")
"""Endings of files that can carry a program."""


def write(policy: PlainPolicy, folder: Path, halved: bool = False) -> None:
    """Write both files into `folder`, which is made.

    halved : weights in half precision, which takes half the room: three figures of each are kept. What is read is then
        not quite the same policy, so it wants a test of its own
    """
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {"action.low": policy.low, "action.high": policy.high}
    for i, layer in enumerate(policy.layers):
        arrays |= {f"layers.{i}.weight": layer.weight, f"layers.{i}.bias": layer.bias}
    if policy.normalization is not None:
        arrays |= {"normalization.mean": policy.normalization.mean, "normalization.std": policy.normalization.std}
    eyes = policy.eyes if isinstance(policy, SeeingPolicy) else None
    if eyes is not None:
        looking: tuple[Layer | Convolution, ...] = (*eyes.convolutions, eyes.layer)
        for i, one in enumerate(looking):
            arrays |= {f"eyes.{i}.weight": one.weight, f"eyes.{i}.bias": one.bias}
    if halved:
        arrays = {name: _half(array) if name.endswith(".weight") else array for name, array in arrays.items()}
    content = bytes_of({name: np.ascontiguousarray(array) for name, array in arrays.items()})
    about = asdict(policy.about)
    text = about.pop("scenario")
    description = {
        "format": FORMAT if halved or eyes is not None else 1,
        **about,
        "scenario": text,
        "scenario_sha256": None if text is None else hashlib.sha256(text.encode()).hexdigest(),
        "observation_size": policy.size,
        "frames": policy.frames,
        "action_size": len(policy.low),
        "squashed": policy.squashed,
        "normalization_clip": None if policy.normalization is None else policy.normalization.clip,
        "layers": [_described(layer) for layer in policy.layers],
        **({} if eyes is None else {"eyes": _described_eyes(eyes)}),
        "arrays_sha256": hashlib.sha256(content).hexdigest(),
    }
    (folder / ARRAYS).write_bytes(content)
    (folder / DESCRIPTION).write_text(json.dumps(description, indent=2), encoding="utf-8")


def read(folder: Path) -> PlainPolicy:
    """The policy that `write` left in `folder`.

    Raises `FileNotFoundError` for a missing file, `ValueError` for one that is damaged, of another format, or asks for
    what no policy may; both name it.
    """
    for name in (DESCRIPTION, ARRAYS):
        if not (folder / name).is_file():
            raise FileNotFoundError(f"{folder} holds no {name}: not a policy's folder")
    stored = read_json(folder / DESCRIPTION)
    if stored.whole("format", 1) > FORMAT:
        raise ValueError(f"{stored.where} is of format {stored.tree['format']}; this program reads up to {FORMAT}")
    arrays = _Arrays(folder / ARRAYS, stored.get("arrays_sha256", str))
    frames, actions = stored.whole("frames", 1), stored.whole("action_size", 1)
    size = stored.whole("observation_size", 0 if "eyes" in stored.tree else 1)
    layers = [_layer(f"layers.{i}", part, arrays) for i, part in enumerate(stored.parts("layers"))]
    eyes = _eyes(stored.part("eyes"), arrays, frames) if "eyes" in stored.tree else None
    widths = [frames * size + (0 if eyes is None else eyes.features), *(len(layer.bias) for layer in layers)]
    for i, layer in enumerate(layers):
        if len(layer.weight) != widths[i]:
            raise ValueError(
                f"{stored.where}: layers[{i}] must take {counted(widths[i], 'number')}, got {len(layer.weight)}"
            )
    if not layers or widths[-1] != actions:
        raise ValueError(
            f"{stored.where}: layers must end in {counted(actions, 'number')}, as an action has, got {widths[1:]}"
        )
    low, high = (arrays.take(f"action.{end}", (actions,), np.float32) for end in ("low", "high"))
    rest = (
        layers, _normalization(stored, arrays, frames * size), low, high, stored.get("squashed", bool), frames,
        _about(stored),
    )  # fmt: skip
    return PlainPolicy(*rest) if eyes is None else SeeingPolicy(eyes, *rest)


def load(folder: str | Path, trust: bool = False) -> PlainPolicy:
    """The policy of `folder`: a policy's own folder, a run's, whose best policy it then is, or a shipped ``trained/…``.

    trust : also open what Stable-Baselines3 or a pickle saved, which runs any program that stands in it

    Raises `FileNotFoundError` or `ValueError`, naming the file; `ValueError` for a folder that needs `trust`.
    """
    given, folder = str(folder), Path(folder)
    if not folder.is_dir():
        shipped = folder_of(given)
        if shipped is None:
            raise FileNotFoundError(f"no folder {given!r} to load a policy from")
        folder = shipped
    held = sorted({path.name for path in folder.rglob("*") if path.suffix.lower() in _PROGRAMS})
    found = best_of(folder)
    while found is not None:
        try:
            policy = read(found)
        except FileNotFoundError:
            newer = best_of(folder)
            if newer in (found, None):
                raise
            found = newer  # a training that goes on here has just put it in the other's place
        else:
            if held:
                note(f"{folder} also holds {', '.join(held)}; such files can carry a program, and were not opened")
            return policy
    if not held:
        raise FileNotFoundError(
            f"{folder} holds no {DESCRIPTION}: not a policy's or a run's folder, or a run that was stopped before its "
            "first evaluation"
        )
    if not trust:
        raise ValueError(
            f"{folder} holds no {DESCRIPTION}, only {', '.join(held)}: such files can carry a program, which opening "
            f"them would run, and were not opened. If you trust where they come from: magwire export {folder} --trust"
        )
    from .trusted import opened

    return opened(folder)


class _Arrays:
    """The arrays of a file with this SHA-256."""

    def __init__(self, path: Path, sha256: str) -> None:
        self.path = path
        if path.stat().st_size > _MOST_BYTES:
            raise ValueError(f"{path} is {path.stat().st_size} bytes long, more than the {_MOST_BYTES} of a policy")
        content = path.read_bytes()
        if hashlib.sha256(content).hexdigest() != sha256:
            raise ValueError(f"{path} is truncated, damaged, or not the one that {DESCRIPTION} was written with")
        try:
            self._arrays = arrays_of(content)
        except (SafetensorError, ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{path} is damaged or no safetensors file: {error}") from error

    def take(self, name: str, shape: tuple[int, ...], kind: type) -> np.ndarray:
        """The array `name`, finite and of this shape and type; single precision may be stored as half."""
        array = self._arrays.get(name)
        if array is not None and array.dtype == np.float16 and kind is np.float32:
            array = array.astype(np.float32)
        if array is None or array.shape != shape or array.dtype != kind:
            got = "none" if array is None else f"{array.shape} of {array.dtype}"
            raise ValueError(f"{self.path}: {name} must have shape {shape} of {np.dtype(kind)}, got {got}")
        if not np.isfinite(array).all():
            raise ValueError(f"{self.path}: {name} must be finite, got NaN or infinity")
        return array


def _half(array: np.ndarray) -> np.ndarray:
    """In half precision; as it is, where a number is too large for that."""
    return array if np.abs(array).max(initial=0.0) > _LARGEST_HALF else array.astype(np.float16)


def _described(layer: Layer | Convolution) -> dict[str, Any]:
    shape = list(layer.weight.shape)
    return {"shape": shape, "activation": layer.activation, "parameters": list(layer.parameters)}


def _described_eyes(eyes: Eyes) -> dict[str, Any]:
    convolutions = [{**_described(one), "stride": one.stride} for one in eyes.convolutions]
    return {"image": list(eyes.shape), "convolutions": convolutions, "layer": _described(eyes.layer)}


def _eyes(stored: Stored, arrays: _Arrays, frames: int) -> Eyes:
    channels, h, w = _shape(stored, "image", 3)
    if channels % frames or max(channels, h, w) > _LARGEST_IMAGE:
        raise ValueError(
            f"{stored.where}: image must have channels for {frames} frames and at most {_LARGEST_IMAGE} px, "
            f"got {[channels, h, w]}"
        )
    made: list[Convolution] = []
    for i, part in enumerate(stored.parts("convolutions")):
        outputs, inputs, k, across = _shape(part, "shape", 4)
        if inputs != (len(made[-1].bias) if made else channels) or k != across:
            raise ValueError(
                f"{part.where}: shape must follow from the image's and be square, got {part.tree['shape']}"
            )
        weight = arrays.take(f"eyes.{i}.weight", (outputs, inputs, k, k), np.float32)
        bias = arrays.take(f"eyes.{i}.bias", (outputs,), np.float32)
        made.append(Convolution(weight, bias, part.whole("stride", 1), *_activation(part)))
    layer = _layer(f"eyes.{len(made)}", stored.part("layer"), arrays)
    flat = Eyes.flat((channels, h, w), made)
    if flat != len(layer.weight):
        raise ValueError(f"{stored.where}: layer must take the {flat} numbers that leave the convolutions")
    return Eyes((channels, h, w), made, layer)


def _shape(stored: Stored, name: str, count: int) -> list[int]:
    shape = stored.get(name, list)
    if len(shape) != count or any(not isinstance(n, int) or isinstance(n, bool) or n < 1 for n in shape):
        raise ValueError(
            f"{stored.where}: {name} must be {_COUNTS[count]} whole numbers of at least 1, got {shape!r:.80}"
        )
    return shape


_COUNTS = {2: "two", 3: "three", 4: "four"}


def _activation(stored: Stored) -> tuple[str, tuple[float, ...]]:
    activation, parameters = stored.one_of("activation", ACTIVATIONS), stored.get("parameters", list)
    count = ACTIVATIONS[activation][1]
    if len(parameters) != count or any(not isinstance(p, (int, float)) for p in parameters):
        raise ValueError(
            f"{stored.where}: parameters of {activation} must be {counted(count, 'number')}, got {parameters!r:.80}"
        )
    return activation, tuple(parameters)


def _layer(name: str, stored: Stored, arrays: _Arrays) -> Layer:
    shape = _shape(stored, "shape", 2)
    activation, parameters = _activation(stored)
    weight = arrays.take(f"{name}.weight", (shape[0], shape[1]), np.float32)
    return Layer(weight, arrays.take(f"{name}.bias", (shape[1],), np.float32), activation, parameters)


def _normalization(stored: Stored, arrays: _Arrays, size: int) -> Normalization | None:
    clip = stored.get("normalization_clip", int, float, type(None))
    if clip is None:
        return None
    mean, std = (arrays.take(f"normalization.{part}", (size,), np.float64) for part in ("mean", "std"))
    if not clip > 0 or not (std > 0).all():
        raise ValueError(f"{stored.where}: normalization_clip and {ARRAYS}'s std must be greater than 0, got {clip!r}")
    return Normalization(mean, std, float(clip))


def _about(stored: Stored) -> PolicyAbout:
    text = stored.get("scenario", str, type(None))
    if text is not None and hashlib.sha256(text.encode()).hexdigest() != stored.get("scenario_sha256", str):
        raise ValueError(f"{stored.where}: scenario is not the one that scenario_sha256 was taken of")
    versions: dict[str, Any] = stored.get("versions", dict)
    return PolicyAbout(
        stored.task(), stored.get("algorithm", str), stored.get("seed", int), stored.whole("timesteps"),
        stored.env("env"), text, stored.get("scenario_given", bool), stored.strings("channels"),
        {str(k): str(v) for k, v in versions.items()},
    )  # fmt: skip
