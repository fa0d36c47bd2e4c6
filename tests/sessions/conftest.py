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
def connection(stage: Rehearsal) -> Iterator[RehearsedClient]:
    """A connection that is nothing yet; it is closed after the test."""
    made = stage.connect()
    yield made
    made.close()
    stage.run(0.05)


@pytest.fixture
def client(stage: Rehearsal) -> Iterator[RehearsedClient]:
    """A world controller; whatever it created is gone after the test."""
    connection = controller(stage)
    yield connection
    connection.send("CONTROL {Type GetSTA}")
    connection.close()
    stage.settle()


@pytest.fixture
def fresh() -> Iterator[Rehearsal]:
    """An empty world for one test."""
    with Rehearsal(world="empty") as rehearsal:
        yield rehearsal
