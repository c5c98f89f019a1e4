"""The subcommand `export`: a policy as plain arrays and as an ONNX graph."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

__all__ = ["Export", "export"]


@dataclass
class Export:
    """Write a run's best policy as plain arrays (policy.json, policy.safetensors) and as an ONNX graph."""

    run: tyro.conf.Positional[Path]
    """Folder of a run or a policy."""
    out: Path | None = None
    """Folder to write to; by default best/ in the run's folder."""
    trust: bool = False
    """Also open a model.zip or pickle of an earlier version, which runs any program that stands in it."""


def export(options: Export) -> None:
    """Write the files and print their names."""
    from agents.learning import load
    from agents.learning.export import save_all

    out = options.out or options.run / "best"
    policy = load(options.run, options.trust)
    save_all(policy, out)
    print("\n".join(str(path) for path in sorted(out.glob("policy.*"))))
