"""Tables along tracts: rows, interpolation, their ends."""

from __future__ import annotations

import numpy as np
import pytest

from magwire_env.quasistatic.along_tract import AlongTract

LENGTHS = np.array([0.10, 0.043, 0.2])


def test_the_rows_cover_every_tract_from_end_to_end():
    along = AlongTract(LENGTHS, 0.01)
    assert along.counts.tolist() == [11, 6, 21]
    assert len(along) == 38
    for k, length in enumerate(LENGTHS):
        own = along.places[along.entries == k]
        assert own[0] == 0.0
        assert length <= own[-1] + 1e-12 < length + 0.01
        assert np.diff(own) == pytest.approx(0.01)


def test_a_linear_function_is_interpolated_exactly_and_clamped_at_the_ends():
    along = AlongTract(LENGTHS, 0.01)
    table = np.stack([2.0 * along.places + along.entries, -along.places], axis=1)
    entries, s = np.array([0, 1, 2, 2, 0]), np.array([0.034, 0.0411, 0.1999, 7.0, -1.0])
    held = np.array([0.034, 0.0411, 0.1999, 0.2, 0.0])
    assert along.between(table, entries, s)[:, 0] == pytest.approx(2.0 * held + entries, abs=1e-12)
    assert along.between(table[:, 1], entries, s) == pytest.approx(-held, abs=1e-12)
    grid = along.between(table, np.array([[0], [1]]), np.array([[0.01, 0.02], [0.01, 0.02]]))
    assert grid.shape == (2, 2, 2)


def test_no_row_reaches_into_the_next_tract():
    along = AlongTract(LENGTHS, 0.01)
    below, share = along.below(np.arange(3), LENGTHS + 1.0)
    assert (along.entries[below + 1] == np.arange(3)).all()
    assert share == pytest.approx(1.0)


def test_mirrored_rows_are_those_from_the_other_end():
    along = AlongTract(LENGTHS, 0.01)
    assert (along.mirrored[along.mirrored] == np.arange(len(along))).all()
    assert (along.entries[along.mirrored] == along.entries).all()
    assert along.places[along.mirrored][along.first] == pytest.approx(along.places[along.first + along.counts - 1])


def test_a_bad_spacing_is_refused():
    with pytest.raises(ValueError, match="spacing must be greater than 0"):
        AlongTract(LENGTHS, 0.0)
