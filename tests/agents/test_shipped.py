"""Trained policies that come with the package: the folder as it is shipped, and how damaged ones are refused."""

from __future__ import annotations

import json

import pytest

from agents import shipped
from agents.benchmark.plan import plain_name
from agents.catalogue import resolve
from agents.learning import load
from magwire_env.envs.task import TASKS


def test_what_is_shipped_is_what_the_manifest_says():
    """Each policy opens, is of the task it names, and is small; nothing lies beside them."""
    entries = shipped.manifest()
    folders = {path.name for path in shipped.SHIPPED.iterdir() if path.is_dir()}
    assert folders == {entry.name for entry in entries}
    assert sum(entry.size for entry in entries) < 1_000_000
    for entry in entries:
        policy = load(shipped.PREFIX + entry.name)
        assert (policy.task, policy.about.algorithm) == (entry.task, entry.algorithm)
        assert entry.task in TASKS
        assert entry.size == sum((shipped.SHIPPED / entry.name / file).stat().st_size for file in shipped.FILES)


def test_every_task_has_one_in_its_newest_version():
    newest = sorted(task for task in TASKS if "-v" not in plain_name(task))
    assert sorted(entry.task for entry in shipped.manifest()) == newest


def test_a_text_that_is_no_such_name():
    assert shipped.folder_of("runs/mine") is None
    with pytest.raises(ValueError, match=r"policy must be a folder or a trained policy .*got 'trained/Nothing-v9'"):
        shipped.folder_of("trained/Nothing-v9")
    with pytest.raises(ValueError, match=r"got 'trained/\.\./\.\.'"):
        load("trained/../..")
    with pytest.raises(ValueError, match="got 'trained/Nothing-v9'"):
        resolve("trained/Nothing-v9")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": 99}, "is of format 99"),
        ({"policies": [{"name": "../elsewhere"}]}, "sha256"),
        ({"policies": [{"name": "../elsewhere", "sha256": {}}]}, "name must be the name of a folder"),
        (
            {"policies": [{"name": "a", "sha256": {}, "task": "T", "algorithm": "ppo", "seed": 0, "timesteps": 1}]},
            "lacks",
        ),
    ],
)
def test_a_damaged_manifest_is_refused(change, words, tmp_path):
    (tmp_path / shipped.MANIFEST).write_text(json.dumps({"format": 1, "policies": []} | change))
    with pytest.raises(ValueError, match=words):
        shipped.manifest(tmp_path)
