"""Shortest ways along path nodes."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_server.worlds.avatars.ways import distances_to, find_node, way_to
from usarsim_server.worlds.description import PathNode

NODES = (
    PathNode("A", (0.0, 0.0, 0.0), ("B", "C")),
    PathNode("B", (1.0, 0.0, 0.0), ("D",)),
    PathNode("C", (0.0, 3.0, 0.0), ("D",)),
    PathNode("D", (1.0, 3.0, 0.0)),
    PathNode("Alone", (9.0, 9.0, 0.0)),
)


def tags(way: list[PathNode]) -> str:
    """The way in one word."""
    return "".join(node.tag for node in way)


def test_the_shortest_way() -> None:
    """Of two ways the shorter one, and both ends are part of it."""
    assert tags(way_to(NODES, "A", "D")) in ("ABD", "ACD")
    assert tags(way_to(NODES, "C", "B")) in ("CAB", "CDB")
    assert tags(way_to(NODES, "A", "A")) == "A"


def test_connections_go_both_ways() -> None:
    """A node that names no neighbours can be left by those who name it."""
    assert tags(way_to(NODES, "D", "B")) == "DB"
    assert distances_to(NODES, "A") == pytest.approx({"A": 0, "B": 1, "C": 3, "D": 4})


def test_where_no_way_leads() -> None:
    """Nothing, and no error."""
    assert way_to(NODES, "Alone", "A") == []
    assert way_to(NODES, "A", "Alone") == []
    assert distances_to(NODES, "Alone") == {"Alone": 0.0}


def test_names_count_without_case() -> None:
    """As tags of start poses do."""
    assert find_node(NODES, " alone ") is NODES[4]
    assert find_node(NODES, "nobody") is None


def test_nodes_in_one_place() -> None:
    """Connections without length do not confuse the search."""
    same = tuple(
        PathNode(tag, (0.0, 0.0, 0.0), tuple(other for other in "PQR" if other != tag))
        for tag in "PQR"
    )
    assert way_to(same, "P", "R")[-1].tag == "R"


@st.composite
def graphs(draw: st.DrawFn) -> tuple[PathNode, ...]:
    """Up to six nodes with random connections."""
    count = draw(st.integers(2, 6))
    names = [chr(ord("A") + n) for n in range(count)]
    pairs = [pair for pair in itertools.combinations(names, 2) if draw(st.booleans())]
    return tuple(
        PathNode(
            name,
            (draw(st.floats(-5, 5)), draw(st.floats(-5, 5)), 0.0),
            tuple(b for a, b in pairs if a == name),
        )
        for name in names
    )


@given(graphs())
@settings(max_examples=100, derandomize=True, deadline=None)
def test_no_way_is_shorter(nodes: tuple[PathNode, ...]) -> None:
    """Among all ways without repetition none is shorter than the one that is found."""
    table = {node.tag: node for node in nodes}
    edges = {(node.tag, other) for node in nodes for other in node.neighbours}
    edges |= {(b, a) for a, b in edges}

    def length(way: tuple[str, ...]) -> float:
        legs = list(itertools.pairwise(way))
        if not all(pair in edges for pair in legs):
            return math.inf
        return sum(math.dist(table[a].position, table[b].position) for a, b in legs)

    goal = nodes[-1].tag
    inner = [node.tag for node in nodes[1:-1]]
    best = min(
        length((nodes[0].tag, *middle, goal))
        for size in range(len(inner) + 1)
        for middle in itertools.permutations(inner, size)
    )
    found = way_to(nodes, nodes[0].tag, goal)
    if math.isinf(best):
        assert found == []
    else:
        assert length(tuple(node.tag for node in found)) == pytest.approx(best, abs=1e-9)
        assert distances_to(nodes, goal)[nodes[0].tag] == pytest.approx(best, abs=1e-9)
