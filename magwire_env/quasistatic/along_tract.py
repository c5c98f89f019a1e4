"""Tables along tracts: evenly spaced places in the tracts of several scenarios, one row a place."""

from __future__ import annotations

import numpy as np

from ..physics.checks import positive

__all__ = ["AlongTract"]


class AlongTract:
    """Evenly spaced places along the tracts of several scenarios, as the rows of one table.

    The rows of one scenario stand together, from the start of its tract to the end; the scenarios follow one another.

    lengths : (k,) m, of the scenarios' tracts
    spacing : m between places

    Attributes
    counts, first : (k,) number of rows of every scenario, and its first row
    entries : (rows,) number of the scenario that a row belongs to
    places : (rows,) m; the last place of a tract may lie beyond its end, by less than `spacing`
    """

    def __init__(self, lengths: np.ndarray, spacing: float) -> None:
        self.spacing = positive("spacing", spacing, "m")
        self.counts = np.ceil(np.asarray(lengths) / self.spacing).astype(np.int64) + 1
        self.first = np.r_[0, self.counts.cumsum()[:-1]]
        self.entries = np.repeat(np.arange(len(self.counts)), self.counts)
        self.places = self.spacing * (np.arange(len(self.entries)) - self.first[self.entries])

    def __len__(self) -> int:
        return len(self.entries)

    @property
    def mirrored(self) -> np.ndarray:
        """(rows,) the row at the same number of steps from the other end of its tract."""
        return 2 * self.first[self.entries] + self.counts[self.entries] - 1 - np.arange(len(self))

    def row(self, entries: np.ndarray, s: np.ndarray) -> np.ndarray:
        """The row of places `s` (…) m in the tracts of `entries` (…), with its fraction; held at the tract's ends."""
        return self.first[entries] + np.clip(s / self.spacing, 0, self.counts[entries] - 1)

    def below(self, entries: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The row below every place (…), and the share of the step to the next row (…) that lies behind the place."""
        row = self.row(entries, s)
        below = np.minimum(row.astype(np.int64), self.first[entries] + self.counts[entries] - 2)
        return below, row - below

    def between(self, table: np.ndarray, entries: np.ndarray, s: np.ndarray) -> np.ndarray:
        """`table` (rows, *k) at places `s` (…) m, linear between its rows, (…, *k)."""
        below, share = self.below(entries, s)
        share = share.reshape(*share.shape, *[1] * (table.ndim - 1))
        return table[below] + share * (table[below + 1] - table[below])
