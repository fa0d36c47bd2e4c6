"""No propagation at all: everybody hears everybody."""

from __future__ import annotations

from usarsim_server.radio.propagation import Propagation, register

__all__ = ["NoPropagation"]


@register("none", "Noop")
class NoPropagation(Propagation):
    """0 dBm everywhere, every link is up, and nobody has to be in the simulator (4.5)."""

    needs_positions = False
    trusting = True

    def strength(self, distance: float, obstacles: int) -> float:
        """Always 0 dBm."""
        return 0.0

    def connects(self, strength: float) -> bool:
        """Always."""
        return True
