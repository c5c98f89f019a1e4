"""Where independent pieces of work are done: in processes of this machine, or on the nodes of a Ray cluster."""

from __future__ import annotations

from .engine import Engine, Lost, Outcome, Task, run
from .local import LocalEngine

__all__ = ["Engine", "LocalEngine", "Lost", "Outcome", "Task", "engine", "run"]


def engine(workers: int, ray: str | None = None) -> Engine:
    """The engine that a command asks for.

    workers : processes at a time, on this machine; with a cluster's address as many as it has processors
    ray : None for the standard library's executors, "local" for Ray on this machine, or a cluster's address

    Raises `ValueError` for no worker, or a cluster that cannot be reached.
    """
    if workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    if ray is None:
        return LocalEngine(workers)
    from .on_ray import RayEngine

    return RayEngine(ray, workers)
