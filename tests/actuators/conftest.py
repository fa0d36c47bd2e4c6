"""Settings of this room's tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import settings

from usarsim_server.testing import Rehearsal, RehearsedClient

settings.register_profile("deterministic", derandomize=True, deadline=None)
settings.load_profile("deterministic")


@pytest.fixture(scope="module")
def stage() -> Iterator[Rehearsal]:
    """One empty world for the tests of commands and texts."""
    with Rehearsal(world="empty", max_robots=64) as rehearsal:
        yield rehearsal


@pytest.fixture
def client(stage: Rehearsal) -> Iterator[RehearsedClient]:
    """A connection that is closed after the test."""
    connection = stage.connect()
    yield connection
    connection.close()
    stage.run(0.05)
