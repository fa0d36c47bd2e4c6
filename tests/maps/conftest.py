"""Fixtures of this room: a cache of one's own, and a way to build small scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from usarsim_maps.findings import Findings


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """No test sees, or leaves, imports in the user's cache."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder


@pytest.fixture
def findings() -> Findings:
    """What an import has to tell."""
    return Findings()


@pytest.fixture
def stage(tmp_path: Path) -> Any:
    """A new stage of USD, `a.usda`; without the library the test skips."""
    return pytest.importorskip("usd_stages").stage_at(tmp_path / "a.usda")
