"""A search for hyperparameters."""

from __future__ import annotations

import pytest
import yaml

from agents.cli.main import main as magwire
from agents.learning.hyperparameters import hyperparameters
from agents.learning.tuning import SPACES, tune

ID = "MagWire/Steer-v1"


def test_a_study_is_written_with_its_trials(tmp_path):
    magwire(["tune", "--trials", "2", "--timesteps", "1024", "--out", str(tmp_path)])
    study = yaml.safe_load((tmp_path / "ppo-Steer-v1.yml").read_text())
    assert [set(t) - {"value", "seconds"} for t in study["trials"]] == [set(SPACES["ppo"])] * 2
    given = hyperparameters("ppo", ID)
    first = study["trials"][0]
    assert first["n_steps"] == given["n_steps"]
    assert first["learning_rate"] == "lin_0.001"
    assert first["policy_kwargs.log_std_init"] == given["policy_kwargs"]["log_std_init"]
    assert study["best"]["value"] == max(t["value"] for t in study["trials"])
    with pytest.raises(ValueError, match="algorithm must be one of 'ppo'"):
        tune(ID, "dqn", out=tmp_path)
    with pytest.raises(ValueError, match="trials must be a whole number of at least 1, got 0"):
        tune(ID, "ppo", trials=0, out=tmp_path)
