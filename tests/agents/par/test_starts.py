"""Plans as actions and as commands."""

from __future__ import annotations

import numpy as np

import magwire_env  # noqa: F401  (registers the ids)
from agents.par.starts import actions_of, commands_of
from magwire_env.quasistatic.pool import scenario_pool
from tests.support.episodes import begun


def test_actions_and_commands_undo_each_other_exactly():
    starts = begun("MagWire/Chase-v0", 2, scenario=list(scenario_pool("Chase", "test", 2)))
    actions = np.random.default_rng(0).uniform(-1, 1, (2, 500, 3)).astype(np.float32)
    again = actions_of(starts.library, starts.entries, commands_of(starts.library, starts.entries, actions))
    assert np.array_equal(again, actions)
