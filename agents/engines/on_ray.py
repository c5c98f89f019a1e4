"""Tasks on the nodes of a Ray cluster. Ray moves tasks and results; files go by a shared folder or a URL."""

from __future__ import annotations

import logging
import os
from collections.abc import Hashable, Iterable
from pathlib import Path
from typing import Any

from magwire_env.render.extra import need

from ..processes import PATIENCE
from .engine import ENVIRONMENT, Lost, Task

__all__ = ["RayEngine"]


class RayEngine:
    """A cluster that is there, or Ray on this machine alone, which then ends with the engine.

    address : "local", "auto", or a cluster's "host:port" or "ray://host:port"
    workers : processors that Ray on this machine alone may use
    """

    def __init__(self, address: str, workers: int) -> None:
        here = address == "local"
        os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
        if not here and ("RAY_AUTH_TOKEN" in os.environ or (Path.home() / ".ray" / "auth_token").exists()):
            os.environ.setdefault("RAY_AUTH_MODE", "token")  # as nodes do by themselves; Ray reads it when imported
        need("ray", "a cluster", "cluster")
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # else a warning at every start
        import ray

        try:
            ray.init(
                address=address, num_cpus=workers if here else None, include_dashboard=False if here else None,
                log_to_driver=False, logging_level=logging.ERROR, runtime_env={"env_vars": ENVIRONMENT},
            )  # fmt: skip
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise ValueError(f"ray must be 'local' or a cluster's address, got {address!r}: {error}") from error
        self._ray: Any = ray
        # Lost tasks come back to `run`, which knows what must not be done twice.
        self._do = ray.remote(num_cpus=1, max_retries=0)(_call)
        self._running: list[Any] = []

    def room(self) -> bool:
        """As `Engine.room`: as many tasks as the living nodes have processors."""
        return len(self._running) < max(1, self.processors())

    def processors(self) -> int:
        """Of the nodes that are alive."""
        return int(self._ray.cluster_resources().get("CPU", 0))

    def submit(self, task: Task, attempt: int) -> Hashable:
        """As `Engine.submit`."""
        ticket = self._do.options(name=task.name).remote(task.work, task.arguments, attempt)
        self._running.append(ticket)
        return ticket

    def wait(self) -> Iterable[tuple[Hashable, Any, BaseException | None]]:
        """As `Engine.wait`."""
        exceptions = self._ray.exceptions
        ended, _ = self._ray.wait(self._running, num_returns=1)
        found: list[tuple[Hashable, Any, BaseException | None]] = []
        for ticket in ended:
            self._running.remove(ticket)
            result, failure = None, None
            try:
                result = self._ray.get(ticket)
            except exceptions.RayTaskError as error:
                failure = getattr(error, "cause", None) or error
            except exceptions.RayError as error:
                failure = Lost(f"{type(error).__name__}: {str(error).splitlines()[0]}")
            found.append((ticket, result, failure))
        return found

    def close(self, hurry: bool = False) -> None:
        """As `Engine.close`."""
        if hurry and self._running:
            for ticket in self._running:  # Ctrl-C there: a training saves
                self._ray.cancel(ticket)
            self._ray.wait(self._running, num_returns=len(self._running), timeout=PATIENCE)
        self._running = []
        self._ray.shutdown()


def _call(work: Any, arguments: tuple[Any, ...], attempt: int) -> Any:
    """A task, in the worker."""
    return work(*arguments, attempt=attempt)
