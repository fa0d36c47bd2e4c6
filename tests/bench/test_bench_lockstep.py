"""As fast as it can: the slowest robot's clock counts."""

from __future__ import annotations

import pytest

from usarsim_bench.server import BenchError
from usarsim_bench.swarm import slowest


def test_is_that_of_the_slowest_robot() -> None:
    """Simulated over wall time, of the robot that got on least."""
    fast = [(10.0 + n * 0.1, n * 0.8) for n in range(11)]
    slow = [(10.0 + n * 0.1, n * 0.7) for n in range(11)]
    assert slowest([fast, slow, fast]) == pytest.approx(7.0)


def test_needs_lines_of_everybody() -> None:
    """A robot that says nothing is an error."""
    with pytest.raises(BenchError, match="too few STA lines"):
        slowest([[(0.0, 0.0), (1.0, 6.0)], [(0.0, 0.0)]])
