"""A tree of plain values and arrays on disk: numbers in a safetensors file, the tree around them in JSON.

What pickle would be used for, without what it can do: reading such a pair makes dicts, lists, strings, numbers, NumPy
arrays and tensors, and nothing else.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.numpy import load_file, save

from .stored import read_json

__all__ = ["load_tree", "save_tree"]


def save_tree(tree: Any, folder: Path, name: str) -> None:
    """Write ``<name>.safetensors`` and ``<name>.json``.

    tree : of dicts, lists, tuples (read back as lists), str, int, float, bool, None, NumPy arrays and numbers, tensors

    Raises `TypeError` for anything else.
    """
    arrays: dict[str, np.ndarray] = {}
    packed = _packed(tree, arrays)
    (folder / f"{name}.safetensors").write_bytes(save(arrays))
    (folder / f"{name}.json").write_text(json.dumps({"tree": packed, "arrays": len(arrays)}), encoding="utf-8")


def load_tree(folder: Path, name: str) -> Any:
    """What `save_tree` wrote. Raises `FileNotFoundError`, or `ValueError` naming the file that is damaged."""
    stored, path = read_json(folder / f"{name}.json"), folder / f"{name}.safetensors"
    try:
        arrays = load_file(path)
    except (SafetensorError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path} is damaged or no safetensors file: {error}") from error
    if len(arrays) != stored.whole("arrays"):
        raise ValueError(f"{path} holds {len(arrays)} arrays where {stored.where} speaks of {stored.tree['arrays']}")
    try:
        return _unpacked(stored.get("tree", list, str, int, float, bool, type(None)), arrays)
    except (KeyError, TypeError, ValueError, IndexError, RecursionError) as error:
        raise ValueError(f"{stored.where} is damaged: {type(error).__name__}: {error}") from error


# In the JSON a list is a tag and what it stands for; everything else is itself.


def _packed(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    if value is None or isinstance(value, (str, bool)) or type(value) in (int, float):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, dict):
        return ["dict", [[_packed(k, arrays), _packed(v, arrays)] for k, v in value.items()]]
    if isinstance(value, (list, tuple)):
        return ["list", [_packed(v, arrays) for v in value]]
    if isinstance(value, (np.ndarray, torch.Tensor)):
        name, array = str(len(arrays)), value if isinstance(value, np.ndarray) else value.detach().cpu().numpy()
        arrays[name] = np.ascontiguousarray(array)
        return ["array" if array is value else "tensor", name, list(array.shape)]
    raise TypeError(f"tree must be of plain values and arrays, got {type(value).__name__}")


def _unpacked(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    if not isinstance(value, list):
        return value
    tag, content, *shape = value
    if tag == "dict":
        return {_unpacked(k, arrays): _unpacked(v, arrays) for k, v in content}
    if tag == "list":
        return [_unpacked(v, arrays) for v in content]
    if tag not in ("array", "tensor"):
        raise ValueError(f"{tag!r} is no tag")
    array = arrays[content].reshape(*shape)  # a number by itself is stored as an array of one
    return array if tag == "array" else torch.from_numpy(array.copy())
