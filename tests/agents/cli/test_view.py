"""Policies to look at, and the time to beat."""

from __future__ import annotations

import gymnasium as gym
import pytest

from agents.cli import view
from agents.cli.view import Play, _policies
from magwire_env.render import play as playing

ID = "MagWire/Steer-v0"


@pytest.mark.parametrize("against", ["MaxForce", "RUN"])
def test_the_time_to_beat(against, run, monkeypatch):
    """`play` asks for it, of a controller or of a trained policy."""
    games: list[playing.Game] = []
    monkeypatch.setattr(playing, "play", games.append)
    view.RUN[Play](Play(against=str(run[0]), task=ID) if against == "RUN" else Play(against=against))
    (game,) = games
    assert game.name == ("MaxForce" if against == "MaxForce" else run[0].name)
    if against == "MaxForce":
        assert game.to_beat == pytest.approx(13.1, abs=0.3)
    else:
        assert game.to_beat is None or 5.0 < game.to_beat < 30.0


def test_policies_are_offered_and_refused_where_they_do_not_fit(run):
    folder, _ = run
    assert "MaxForce" in _policies((), False)
    give = _policies((str(folder),), False)[str(folder)]
    other = gym.make(ID, observe=("tip_arclength",))
    with pytest.raises(ValueError, match=r"to see 7 numbers \(tip_arclength, .*shows 1 number \(tip_arclength\)$"):
        give(other)
    assert give(gym.make(ID)).predict(gym.make(ID).reset(seed=0)[0])[0].shape == (1,)
