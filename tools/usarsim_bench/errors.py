"""The one error of this package."""

from __future__ import annotations


class BenchError(RuntimeError):
    """A measurement could not be taken; says why."""
