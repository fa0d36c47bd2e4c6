"""Fixtures of this room."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from control_harness import controller, leave

from usarsim_server.testing import Rehearsal, RehearsedClient


@pytest.fixture(scope="module")
def empty() -> Iterator[Rehearsal]:
    """One empty world for all tests of a file."""
    with Rehearsal(world="empty", max_robots=64) as rehearsal:
        yield rehearsal


@pytest.fixture
def stage(empty: Rehearsal) -> Iterator[Rehearsal]:
    """That world; everybody who came during the test has left after it."""
    before = len(empty._clients)
    yield empty
    leave(empty, *empty._clients[before:])


@pytest.fixture
def connection(stage: Rehearsal) -> RehearsedClient:
    """A connection that is nothing yet."""
    return stage.connect()


@pytest.fixture
def client(stage: Rehearsal) -> RehearsedClient:
    """A world controller; whatever it created is gone after the test."""
    return controller(stage)


@pytest.fixture
def fresh() -> Iterator[Rehearsal]:
    """An empty world for one test."""
    with Rehearsal(world="empty") as rehearsal:
        yield rehearsal
