"""What holds for all tests: none of them decides what the next one may log, and those that draw
their examples draw the same ones every time, for as long as they need.

`HYPOTHESIS_PROFILE=explore` draws new examples instead.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

from usarsim_server.logs import ROOT

PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("explore", PATIENT)
settings.register_profile("same", PATIENT, derandomize=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))


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
