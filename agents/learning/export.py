"""Stable-Baselines3 models as plain policies, and plain policies as ONNX graphs."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from sb3_contrib.common.torch_layers import BatchRenorm
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

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
        modules = [policy.pi_features_extractor, policy.mlp_extractor.policy_net, policy.action_net]
        squashed = bool(policy.squash_output)
    else:
        actor: Any = policy.actor  # type: ignore[attr-defined]
        modules, squashed = [actor.features_extractor, actor.latent_pi, actor.mu], True
    parts = [part for module in modules for part in _flat(module)]
    space: Any = model.action_space
    made = PlainPolicy(
        _layers(parts), _normalization(model.get_vec_normalize_env()), space.low.astype(np.float32),
        space.high.astype(np.float32), squashed, frames, about,
    )  # fmt: skip
    _check(made, model)
    return made


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
    return Normalization(rms.mean.astype(np.float64), np.sqrt(rms.var + env.epsilon), float(env.clip_obs))


def _check(made: PlainPolicy, model: BaseAlgorithm) -> None:
    """Raise `ValueError` unless both act alike, on observations as they come and on ones far out."""
    rng = np.random.default_rng(0)
    normal = made.normalization
    drawn = rng.standard_normal((64, len(made.layers[0].weight))) * rng.uniform(0.1, 4.0, (64, 1))
    seen = (drawn if normal is None else normal.mean + normal.std * drawn).astype(np.float32)
    env = model.get_vec_normalize_env()
    theirs, _ = model.predict(seen if env is None else env.normalize_obs(seen), deterministic=True)
    gap = float(np.abs(made._act(seen) - theirs).max())
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
    """Write the policy as an ONNX graph: raw observation (n, frames · size) → action (n, k), both float32."""
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

    x = "observation"
    if policy.normalization is not None:
        normal = policy.normalization
        x = add("Cast", x, to=TensorProto.DOUBLE)
        x = add("Sub", x, constant("mean", normal.mean, np.float64))
        x = add("Div", x, constant("std", normal.std, np.float64))
        x = clip(x, "normal", -normal.clip, normal.clip, np.float64)
        x = add("Cast", x, to=TensorProto.FLOAT)
    for i, layer in enumerate(policy.layers):
        weights = constant(f"weight_{i}", layer.weight, np.float32), constant(f"bias_{i}", layer.bias, np.float32)
        x = add("Gemm", x, *weights)
        if layer.activation == "clip":
            x = clip(x, f"layer_{i}", layer.parameters[0], layer.parameters[1], np.float32)
        elif layer.activation == "silu":
            x = add("Mul", x, add("Sigmoid", x))
        elif layer.activation != "identity":
            kind, *names = _ONNX_KINDS[layer.activation]
            x = add(kind, x, **dict(zip(names, layer.parameters, strict=True)))
    low, high = constant("low", policy.low, np.float32), constant("high", policy.high, np.float32)
    if policy.squashed:
        x = add("Add", add("Tanh", x), constant("one", 1.0, np.float32))
        x = add("Add", add("Mul", x, constant("half_range", (policy.high - policy.low) / 2, np.float32)), low)
    else:
        x = add("Min", add("Max", x, low), high)
    nodes[-1].output[0] = "action"
    sizes = {"observation": len(policy.layers[0].weight), "action": len(policy.low)}
    ends = [helper.make_tensor_value_info(n, TensorProto.FLOAT, ["n", size]) for n, size in sizes.items()]
    graph = helper.make_graph(nodes, "policy", ends[:1], ends[1:], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    about = policy.about
    model.doc_string = f"{about.algorithm} on {about.task}; observes {', '.join(about.channels)} × {policy.frames}"
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())


_ONNX_KINDS: dict[str, tuple[str, ...]] = {
    "tanh": ("Tanh",), "relu": ("Relu",), "sigmoid": ("Sigmoid",), "elu": ("Elu", "alpha"),
    "leaky_relu": ("LeakyRelu", "alpha"),
}  # fmt: skip
