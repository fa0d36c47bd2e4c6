"""Marks parameters of tests as slow: `make test` keeps a few of them, CI runs all."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest

SLOW = pytest.mark.slow


def slow_but(kept: Callable[[Any], bool], values: Iterable[Any]) -> list[Any]:
    """Mark parameters as slow, but for those kept.

    Args:
        kept: whether a parameter stays in the fast lane; a tuple is one parameter set.
    """
    return [
        value
        if kept(value)
        else pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=SLOW)
        for value in values
    ]
