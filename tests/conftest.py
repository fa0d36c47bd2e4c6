"""What holds for all tests: none of them decides what the next one may log."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest

from usarsim_server.logs import ROOT


@pytest.fixture(autouse=True)
def _logging_as_it_was() -> Iterator[None]:
    """Take back what a test, or a command that it runs, sets up about logging."""
    root, ours = logging.getLogger(), logging.getLogger(ROOT)
    kept = root.level, ours.level, ours.propagate, list(root.handlers)
    yield
    root.setLevel(kept[0])
    ours.setLevel(kept[1])
    ours.propagate = kept[2]
    for handler in [one for one in root.handlers if one not in kept[3]]:
        root.removeHandler(handler)
