"""Fixtures of this room."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from control_harness import controller

from usarsim_server.testing import Rehearsal, RehearsedClient


@pytest.fixture(scope="module")
def stage() -> Iterator[Rehearsal]:
    """One empty world for all tests of this file."""
    with Rehearsal(world="empty", max_robots=32) as rehearsal:
        yield rehearsal


@pytest.fixture
def client(stage: Rehearsal) -> Iterator[RehearsedClient]:
    """A world controller; whatever it created is gone after the test."""
    connection = controller(stage)
    yield connection
    connection.send("CONTROL {Type GetSTA}")
    connection.close()
    stage.settle()
