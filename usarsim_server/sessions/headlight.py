"""The headlight: DRIVE switches it, STA reports it, cameras see what it shines on."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["Headlight"]


class Headlight:
    """Shows everybody whether the lamp that a pilot switches is lit; may be read by any thread."""

    def __init__(self) -> None:
        """Until it is connected it is dark."""
        self._read: Callable[[], bool] = lambda: False

    def connect(self, read: Callable[[], bool]) -> None:
        """Show what a function says; it must return at once."""
        self._read = read

    @property
    def lit(self) -> bool:
        """Whether it is on and has power."""
        return self._read()
