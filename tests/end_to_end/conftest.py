"""A server process per module; end-to-end tests talk to it over sockets only."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from usarsim_server.testing import ScriptedClient, ServerProcess


@pytest.fixture(scope="module")
def server() -> Iterator[ServerProcess]:
    """A server with a flat, empty world and room for many robots."""
    with ServerProcess("--world", "empty", "--max-robots", "64", "--log-level", "info") as process:
        yield process


@pytest.fixture
def connect(server: ServerProcess) -> Iterator[Callable[[], ScriptedClient]]:
    """Makes connections that are closed after the test."""
    clients: list[ScriptedClient] = []

    def make() -> ScriptedClient:
        client = server.client()
        clients.append(client)
        return client

    yield make
    for client in clients:
        client.close()


@pytest.fixture
def client(connect: Callable[[], ScriptedClient]) -> ScriptedClient:
    """One connection whose greeting has been read."""
    connection = connect()
    connection.wait_for("NFO {Gametype")
    return connection
