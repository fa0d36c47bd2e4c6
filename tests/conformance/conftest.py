"""A server of our own that several tests ask."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import pytest

from usarsim_conformance.own_server import judged_server


@pytest.fixture(scope="session")
def own_ports() -> Iterator[Mapping[str, int]]:
    """Ports by service of our own server, whose time passes as fast as the machine goes."""
    with judged_server("--speed", "max") as server:
        yield server.ports
        assert not server.died, server.said
