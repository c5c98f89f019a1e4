"""The least-squares problem behind an identification: unknowns, residuals, their derivatives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from .rollouts import Predictor

__all__ = ["Problem"]

_START_REACH, _START_STEP = 15e-3, 1e-8
"""m: how far from its first reading a tip may start, and the step of the finite difference, see `Parameter.step`."""

_FAR = 1e6
"""Residual, in standard deviations, of what could not be predicted."""


class Problem:
    """Unknowns x: the parameters as they are searched, then where each episode's tip starts (m).

    noise : (kinds,) standard deviation of each kind of measurement
    horizon : rows of each episode that count; others have residuals of zero
    low, high : of x
    """

    def __init__(self, predictor: Predictor, spans: Sequence[tuple[float, float]], noise: np.ndarray) -> None:
        parameters, starts = predictor.parameters, predictor.starts
        self.predictor, self.parameters, self.noise = predictor, parameters, np.asarray(noise, dtype=float)
        self.count, self.horizon = len(parameters), predictor.rows
        ends = np.array([[p.to_search(v) for v in span] for p, span in zip(parameters, spans, strict=True)])
        self.low = np.concatenate([ends[:, 0], starts - _START_REACH])
        self.high = np.concatenate([ends[:, 1], starts + _START_REACH])
        self.steps = np.array([p.step for p in parameters] + [_START_STEP] * len(starts))

    @property
    def size(self) -> int:
        """How many unknowns there are."""
        return len(self.low)

    def values(self, x: np.ndarray) -> np.ndarray:
        """The parameters' values, (..., p), of x (..., size)."""
        x = np.asarray(x)
        return np.stack([np.exp(x[..., i]) if p.ratio else x[..., i] for i, p in enumerate(self.parameters)], axis=-1)

    def predicted(self, xs: np.ndarray) -> np.ndarray:
        """(K, M) of K vectors of unknowns."""
        return self.predictor(self.values(xs), xs[:, self.count :])

    def residuals(self, xs: np.ndarray) -> np.ndarray:
        """(K, M) predicted less measured, in standard deviations of the noise."""
        predictor = self.predictor
        predicted = predictor(self.values(xs), xs[:, self.count :], self.horizon)
        gaps = (predicted - predictor.measured) / self.noise[predictor.kinds]
        gaps = np.where(np.isfinite(gaps), np.clip(gaps, -_FAR, _FAR), _FAR)
        return np.where(predictor.row_of < self.horizon, gaps, 0.0)

    def jacobian(self, x: np.ndarray, free: np.ndarray) -> np.ndarray:
        """(M, free) derivatives of the residuals by the unknowns numbered `free`, in one batch: central differences,
        one-sided where x lies on a bound."""
        ups = np.minimum(x[free] + self.steps[free], self.high[free])
        downs = np.maximum(x[free] - self.steps[free], self.low[free])
        xs = np.tile(x, (2 * len(free), 1))
        rows = np.arange(len(free))
        xs[rows, free], xs[len(free) + rows, free] = ups, downs
        found = self.residuals(xs)
        return ((found[: len(free)] - found[len(free) :]) / (ups - downs)[:, None]).T

    def solve(self, x: np.ndarray, free: np.ndarray | None = None) -> tuple[np.ndarray, float]:
        """Least squares from `x` over the unknowns numbered `free`, by default all → best x, sum of squares."""
        free = np.arange(self.size) if free is None else free
        margin = 1e-9 * (self.high - self.low)
        x = np.clip(x, self.low + margin, self.high - margin)
        if not free.size:
            return x, float((self.residuals(x[None])[0] ** 2).sum())

        def whole(part: np.ndarray) -> np.ndarray:
            full = x.copy()
            full[free] = part
            return full

        found = least_squares(
            lambda part: self.residuals(whole(part)[None])[0],
            x[free],
            jac=lambda part: self.jacobian(whole(part), free),
            bounds=(self.low[free], self.high[free]),
            x_scale="jac",
            ftol=1e-8, xtol=1e-12, gtol=1e-12, max_nfev=120,
        )  # fmt: skip
        return whole(found.x), 2.0 * float(found.cost)
