"""Random lumens: seeded, within their bounds, and as the laws they are drawn by."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest

from magwire_env.lumen.random_trees import KINDS, TreeBounds, grow, within_bounds


def digest(lumen):
    return hashlib.sha256(repr(lumen.branches).encode()).hexdigest()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("split", ["train", "test", "ood"])
def test_a_seed_is_a_value(kind, split):
    lumens = [grow(seed, split, kind) for seed in range(4)]
    assert lumens == [grow(seed, split, kind) for seed in range(4)]
    assert len(set(lumens)) == 4
    for lumen in lumens:
        assert (lumen.leaves == ("trunk",)) if kind == "bowel" else 3 <= len(lumen.leaves) <= 15
        if kind != "bowel":
            within_bounds(lumen, TreeBounds(), odd=split == "ood")


def test_splits_and_kinds_share_no_stream_and_another_process_grows_the_same():
    grown = {(k, s): digest(grow(7, s, k)) for k in KINDS for s in ("train", "test", "ood")}
    assert len(set(grown.values())) == len(grown)
    code = (
        "import hashlib; from magwire_env.lumen.random_trees import grow;"
        "print(hashlib.sha256(repr(grow(7, 'ood', 'vessels').branches).encode()).hexdigest())"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == grown["vessels", "ood"]


@pytest.mark.parametrize("kind", ["vessels", "bronchi"])
def test_radii_at_a_fork_follow_murray_and_branches_keep_apart(kind):
    for seed in range(6):
        lumen = grow(seed, "train", kind)
        for i, b in enumerate(lumen.branches):
            children = [c for j, c in enumerate(lumen.branches) if lumen.parents[j] == i]
            if not children:
                continue
            assert len(children) == 2
            end = float(b.radius(b.length))
            own = [c.curve.radius[0] / 0.98 for c in children]  # a child's funnel starts at 0.98 of its parent's end
            assert own == pytest.approx([end, end], rel=2e-2)
            settled = [max(c.radius(np.linspace(min(3 * end, 0.9 * c.length), c.length, 40))) for c in children]
            if min(settled) > 1.2 * 0.78e-3:  # wider than the least radius a fork gives
                assert np.sum(np.array(settled) ** 3) <= 1.05 * end**3
                assert np.sum(np.array(settled) ** 3) >= 0.4 * end**3
        for b in lumen.branches:  # away from its ends a branch's own wall is the nearest
            s = np.linspace(min(3.2 * b.widest, 0.5 * b.length), b.length - min(3.2 * b.widest, 0.4 * b.length), 12)
            assert lumen.wall_distance(b.curve.position(s)) == pytest.approx(b.radius(s), rel=0.08)


def test_angles_of_an_even_fork_are_those_of_murray():
    angles = []
    for seed in range(12):
        lumen = grow(seed, "train", "bronchi")
        for b in lumen.branches[1:]:
            parent = lumen.branch(b.parent)
            angles.append(np.degrees(np.arccos(parent.curve.tangent(b.start) @ b.curve.tangent(0.0))))
    assert 30 < np.mean(angles) < 45  # 37.5 degrees where both are equal


def test_bounds_and_arguments_are_refused_by_name():
    for make, words in (
        (lambda: grow(-1), "seed must be"),
        (lambda: grow(0, "valid"), "split must be one of"),
        (lambda: grow(0, kind="roots"), "kind must be one of"),
        (lambda: TreeBounds(leaves=(5, 3)), "leaves and radius must be"),
        (lambda: TreeBounds(box=(0.1, 0, 0.1)), r"box\[1\] must be greater"),
        (lambda: grow(0, bounds=TreeBounds(box=(0.02, 0.02, 0.02))), "must leave room"),
    ):
        with pytest.raises(ValueError, match=words):
            make()
    with pytest.raises(ValueError, match="leaves must lie in"):
        within_bounds(grow(0), TreeBounds(leaves=(20, 30)))
