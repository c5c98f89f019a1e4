"""Plans that tests make do not land in the user's cache."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("cache")
    before = os.environ.get("MAGWIRE_CACHE")
    os.environ["MAGWIRE_CACHE"] = str(folder)
    yield folder
    del os.environ["MAGWIRE_CACHE"]
    if before is not None:
        os.environ["MAGWIRE_CACHE"] = before
