"""A workshop that all acceptance tests share, so that equal turns are driven only once."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from motion.workshop import Workshop


@pytest.fixture(scope="session")
def shop() -> Iterator[Workshop]:
    """Test scenes and special robots; robots are looked at every fourth step, and
    turns for a third of the time of the bench."""
    with Workshop(turn_seconds=3.0, script_seconds=6.0, every=4) as workshop:
        yield workshop
