"""The shared look of plots."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np

from magwire_env.plotting import BLUE, blank, broken, rgb, styled


def test_colours_as_numbers():
    assert rgb(BLUE) == (0, 114, 178)


def test_a_line_is_broken_at_jumps_only():
    values = np.array([0.0, 0.1, 3.0, 3.1])
    assert np.isnan(broken(values, 1.0)).tolist() == [False, False, True, False]
    assert not np.isnan(values).any()


def test_the_style_lasts_as_long_as_its_context_and_figures_open_no_window():
    before = mpl.rcParams["font.size"]
    with styled():
        assert mpl.rcParams["font.size"] == 9
        figure, axes = blank(1, 2)
    assert mpl.rcParams["font.size"] == before
    assert len(axes) == 2
    assert type(figure.canvas).__name__ == "FigureCanvasAgg"
