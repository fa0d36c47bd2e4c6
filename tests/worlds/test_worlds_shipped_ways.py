"""Path nodes of the shipped worlds: a person can walk every connection."""

from __future__ import annotations

import math

import pytest

from usarsim_server.app import Assembly, assemble
from usarsim_server.settings import Settings
from usarsim_server.worlds.avatars.ways import distances_to, ground_below, survey


@pytest.fixture(scope="module", params=["arena", "office"])
def shipped(request: pytest.FixtureRequest) -> Assembly:
    """A shipped world that has path nodes."""
    return assemble(Settings(world=request.param, speed=math.inf, port=None))


def test_nodes_lie_on_the_ground(shipped: Assembly) -> None:
    """The height of every node is that of the floor there."""
    for node in shipped.world.path_nodes:
        x, y, z = node.position
        (height,) = ground_below(shipped.simulation, [(x, y, z + 1.0)])
        assert height == pytest.approx(z, abs=0.02), node.tag


def test_every_connection_can_be_walked(shipped: Assembly) -> None:
    """No wall and no high step between neighbours, in either direction."""
    places = {node.tag: node.position for node in shipped.world.path_nodes}
    for node in shipped.world.path_nodes:
        for other in node.neighbours:
            for one, goal in ((node.tag, other), (other, node.tag)):
                seen = survey(shipped.simulation, places[one], places[goal][:2])
                assert seen.obstacle is None, f"{one} to {goal} at {seen.profile[-1]}"


def test_connections_have_two_ends(shipped: Assembly) -> None:
    """Neighbours name each other, and every node can be reached from every other."""
    nodes = {node.tag: node for node in shipped.world.path_nodes}
    for node in nodes.values():
        assert all(node.tag in nodes[other].neighbours for other in node.neighbours), node.tag
    assert distances_to(shipped.world.path_nodes, next(iter(nodes))).keys() == nodes.keys()
