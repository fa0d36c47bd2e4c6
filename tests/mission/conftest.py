"""What tests of missions share."""

from __future__ import annotations

from pathlib import Path

import pytest
from whole_run import begin, play


@pytest.fixture(scope="session")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of a whole run; not to be changed."""
    folder = tmp_path_factory.mktemp("runs") / "one"
    run = begin(folder)
    play(run)
    run.close()
    return folder
