"""Stable-Baselines3 models as plain policies, and plain policies as ONNX graphs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from sb3_contrib.common.torch_layers import BatchRenorm
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import CombinedExtractor
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

from .plain_eyes import Convolution, Eyes, SeeingPolicy
from .plain_policy import Layer, Normalization, PlainPolicy, PolicyAbout
from .policy_file import write

__all__ = ["ONNX", "about_model", "plain", "save_all", "to_onnx"]

ONNX = "policy.onnx"

_OTHER = 1e-4
"""Actions of a model and of its plain policy that differ by more are of different networks; rounding gives 1e-7."""


def plain(model: BaseAlgorithm, about: PolicyAbout, frames: int = 1) -> PlainPolicy:
    """The deterministic policy of a model with its normalisation, as it stands.

    frames : observations that its env stacks

    Raises `ValueError` for a network with parts that have no plain form, or whose plain form acts differently.
    """
    policy = model.policy
    if isinstance(policy, ActorCriticPolicy):
        extractor: Any = policy.pi_features_extractor
        modules: list[Any] = [policy.mlp_extractor.policy_net, policy.action_net]
        squashed = bool(policy.squash_output)
    else:
        actor: Any = policy.actor  # type: ignore[attr-defined]
        extractor = actor.features_extractor
        modules, squashed = [actor.latent_pi, actor.mu], True
    eyes = _eyes(extractor) if isinstance(extractor, CombinedExtractor) else None
    if eyes is None:
        modules.insert(0, extractor)
    parts = [part for module in modules for part in _flat(module)]
    space: Any = model.action_space
    rest = (
        _layers(parts), _normalization(model.get_vec_normalize_env()), space.low.astype(np.float32),
        space.high.astype(np.float32), squashed, frames, about,
    )  # fmt: skip
    made = PlainPolicy(*rest) if eyes is None else SeeingPolicy(eyes, *rest)
    _check(made, model)
    return made


def _eyes(extractor: CombinedExtractor) -> Eyes:
    """What looks at the image; the numbers beside it enter the network as they are."""
    kinds = {name: type(part).__name__ for name, part in extractor.extractors.items()}
    if kinds not in ({"image": "NatureCNN"}, {"image": "NatureCNN", "state": "Flatten"}):
        raise ValueError(f"policy must look at one image by a NatureCNN, and at numbers as they are, got {kinds}")
    cnn: Any = extractor.extractors["image"]
    made: list[Convolution] = []
    for part in _flat(cnn.cnn):
        if isinstance(part, nn.Conv2d):
            plain_form = (part.padding, part.dilation, part.groups) == ((0, 0), (1, 1), 1)
            if not plain_form or part.stride[0] != part.stride[1]:
                raise ValueError(f"policy must have convolutions without padding, dilation and groups, got {part}")
            bias = np.zeros(part.out_channels) if part.bias is None else part.bias.detach().numpy()
            made.append(Convolution(_single(part.weight.detach().numpy()), _single(bias), part.stride[0]))
        else:
            name, numbers = _activation(part)
            if not made or made[-1].activation != "identity":
                raise ValueError(f"policy must alternate convolutions and activations, got {name} out of turn")
            made[-1] = replace(made[-1], activation=name, parameters=numbers)
    shape: Any = extractor._observation_space["image"].shape  # type: ignore[index]
    return Eyes(shape, made, _layers(list(_flat(cnn.linear)))[0])


def _flat(module: nn.Module) -> Iterator[nn.Module]:
    """The network's parts in the order they are gone through."""
    name = type(module).__name__
    if isinstance(module, nn.Sequential):
        for part in module:
            yield from _flat(part)
    elif name not in ("FlattenExtractor", "Flatten", "Identity", "Dropout"):
        yield module


def _layers(parts: list[nn.Module]) -> list[Layer]:
    """Linear layers with their activations; a batch renormalisation goes into the linear layer behind it."""
    layers: list[Layer] = []
    scale: Any = 1.0
    shift: Any = 0.0  # with `scale`, of what enters the next linear layer
    for part in parts:
        if isinstance(part, BatchRenorm):
            factor = (part.ra_var.double() + part.eps).rsqrt().numpy()  # type: ignore[operator, union-attr]
            offset = -part.ra_mean.double().numpy() * factor  # type: ignore[operator, union-attr]
            if part.affine:
                gain = part.scale.detach().double().numpy()
                factor, offset = factor * gain, offset * gain + part.bias.detach().double().numpy()
            scale, shift = scale * factor, shift * factor + offset
        elif isinstance(part, nn.Linear):
            weight = part.weight.detach().double().numpy()
            bias = part.bias.detach().double().numpy() + weight @ np.broadcast_to(shift, weight.shape[1:])
            layers.append(Layer(_single((weight * scale).T), _single(bias)))
            scale, shift = 1.0, 0.0
        else:
            name, numbers = _activation(part)
            if not layers or layers[-1].activation != "identity" or np.ndim(scale):
                raise ValueError(f"policy must alternate linear layers and activations, got {name} out of turn")
            layers[-1] = Layer(layers[-1].weight, layers[-1].bias, name, numbers)
    return layers


def _activation(part: nn.Module) -> tuple[str, tuple[float, ...]]:
    if isinstance(part, nn.Hardtanh):  # ReLU6 is one
        return "clip", (float(part.min_val), float(part.max_val))
    if isinstance(part, nn.ELU):
        return "elu", (float(part.alpha),)
    if isinstance(part, nn.LeakyReLU):
        return "leaky_relu", (float(part.negative_slope),)
    plain_ones: dict[type, str] = {nn.Tanh: "tanh", nn.ReLU: "relu", nn.SiLU: "silu", nn.Sigmoid: "sigmoid"}
    if type(part) not in plain_ones:
        raise ValueError(f"policy must be of linear layers and known activations, got {type(part).__name__}")
    return plain_ones[type(part)], ()


def _single(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, dtype=np.float32)


def _normalization(env: VecNormalize | None) -> Normalization | None:
    if env is None or not env.norm_obs:
        return None
    rms: Any = env.obs_rms
    if isinstance(rms, dict):
        rms = rms["state"]
    return Normalization(rms.mean.astype(np.float64), np.sqrt(rms.var + env.epsilon), float(env.clip_obs))


def _check(made: PlainPolicy, model: BaseAlgorithm) -> None:
    """Raise `ValueError` unless both act alike, on observations as they come and on ones far out."""
    rng = np.random.default_rng(0)
    normal = made.normalization
    drawn = rng.standard_normal((64, made.size * made.frames)) * rng.uniform(0.1, 4.0, (64, 1))
    seen: Any = (drawn if normal is None else normal.mean + normal.std * drawn).astype(np.float32)
    if isinstance(made, SeeingPolicy):
        numbers = {"state": seen} if made.size else {}
        seen = {"image": rng.integers(0, 256, (64, *made.eyes.shape), dtype=np.uint8)} | numbers
    env = model.get_vec_normalize_env()
    theirs, _ = model.predict(seen if env is None else env.normalize_obs(seen), deterministic=True)
    gap = float(np.abs(made.act(seen) - theirs).max())
    if not gap <= _OTHER:
        raise ValueError(f"policy must act as its plain form does, got actions that differ by {gap:.3g}")


def about_model(model: BaseAlgorithm, meta: dict[str, Any]) -> PolicyAbout:
    """What a model was trained for; `meta` has task, algorithm, seed, env, scenario and scenario_given."""
    env: Any = model.get_env()
    while hasattr(env, "venv"):
        env = env.venv
    packages = ("magwire-env", "stable-baselines3", "torch", "numpy")
    return PolicyAbout(
        meta["task"], meta["algorithm"], meta["seed"], int(model.num_timesteps), meta["env"], meta["scenario"],
        meta["scenario_given"], tuple(env.env.core.observer.names), {name: version(name) for name in packages},
    )  # fmt: skip


def save_all(policy: PlainPolicy, folder: Path) -> None:
    """A policy's folder: the plain arrays, and the ONNX graph beside them."""
    write(policy, folder)
    to_onnx(policy, folder / ONNX)


def to_onnx(policy: PlainPolicy, path: Path) -> None:
    """Write the policy as an ONNX graph: raw observation (n, frames · size) → action (n, k), both float32.

    Of a policy that sees an image, there are two inputs, "image" (n, channels, h, w) uint8 and "state"; the latter only
    where it sees numbers too.
    """
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    nodes: list[Any] = []
    constants: list[Any] = []

    def constant(name: str, value: Any, kind: type) -> str:
        constants.append(numpy_helper.from_array(np.asarray(value, dtype=kind), name))
        return name

    def add(kind: str, *inputs: str, **attributes: Any) -> str:
        nodes.append(helper.make_node(kind, list(inputs), [f"{kind.lower()}_{len(nodes)}"], **attributes))
        return nodes[-1].output[0]

    def clip(x: str, name: str, low: Any, high: Any, kind: type) -> str:
        return add("Clip", x, constant(f"{name}_low", low, kind), constant(f"{name}_high", high, kind))

    def activated(x: str, layer: Layer | Convolution, name: str) -> str:
        if layer.activation == "clip":
            return clip(x, name, layer.parameters[0], layer.parameters[1], np.float32)
        if layer.activation == "silu":
            return add("Mul", x, add("Sigmoid", x))
        if layer.activation == "identity":
            return x
        kind, *names = _ONNX_KINDS[layer.activation]
        return add(kind, x, **dict(zip(names, layer.parameters, strict=True)))

    def gemm(x: str, layer: Layer, name: str) -> str:
        weight = constant(f"weight_{name}", layer.weight, np.float32)
        y = add("Gemm", x, weight, constant(f"bias_{name}", layer.bias, np.float32))
        return activated(y, layer, f"layer_{name}")

    eyes = policy.eyes if isinstance(policy, SeeingPolicy) else None
    x = "observation" if eyes is None else "state"
    if policy.normalization is not None:
        normal = policy.normalization
        x = add("Cast", x, to=TensorProto.DOUBLE)
        x = add("Sub", x, constant("mean", normal.mean, np.float64))
        x = add("Div", x, constant("std", normal.std, np.float64))
        x = clip(x, "normal", -normal.clip, normal.clip, np.float64)
        x = add("Cast", x, to=TensorProto.FLOAT)
    if eyes is not None:
        y = add("Div", add("Cast", "image", to=TensorProto.FLOAT), constant("white", 255.0, np.float32))
        for i, one in enumerate(eyes.convolutions):
            kernel = constant(f"kernel_{i}", one.weight, np.float32)
            y = add("Conv", y, kernel, constant(f"shift_{i}", one.bias, np.float32), strides=[one.stride] * 2)
            y = activated(y, one, f"convolution_{i}")
        y = gemm(add("Flatten", y, axis=1), eyes.layer, "eyes")
        x = add("Concat", y, x, axis=1) if policy.size else y
    for i, layer in enumerate(policy.layers):
        x = gemm(x, layer, str(i))
    low, high = constant("low", policy.low, np.float32), constant("high", policy.high, np.float32)
    if policy.squashed:
        x = add("Add", add("Tanh", x), constant("one", 1.0, np.float32))
        x = add("Add", add("Mul", x, constant("half_range", (policy.high - policy.low) / 2, np.float32)), low)
    else:
        x = add("Min", add("Max", x, low), high)
    nodes[-1].output[0] = "action"
    name = "observation" if eyes is None else "state"
    sizes = {"action": len(policy.low)} | ({name: policy.size * policy.frames} if policy.size else {})
    ends = [helper.make_tensor_value_info(n, TensorProto.FLOAT, ["n", size]) for n, size in sizes.items()]
    if eyes is not None:
        ends.append(helper.make_tensor_value_info("image", TensorProto.UINT8, ["n", *eyes.shape]))
    graph = helper.make_graph(nodes, "policy", ends[1:], ends[:1], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    about = policy.about
    model.doc_string = f"{about.algorithm} on {about.task}; observes {policy.sees} × {policy.frames}"
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())


_ONNX_KINDS: dict[str, tuple[str, ...]] = {
    "tanh": ("Tanh",), "relu": ("Relu",), "sigmoid": ("Sigmoid",), "elu": ("Elu", "alpha"),
    "leaky_relu": ("LeakyRelu", "alpha"),
}  # fmt: skip
