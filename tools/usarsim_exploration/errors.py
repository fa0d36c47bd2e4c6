"""What a user of `usarsim explore` can do wrong; see `usarsim_server.errors`."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from usarsim_server.errors import UsarsimError
from usarsim_server.extras import need


class ExplorationError(UsarsimError):
    """A scenario, or a file that belongs to a run, cannot be used."""


def scipy(part: str) -> Any:
    """A part of scipy, which only some strategies need.

    Args:
        part: such as `optimize`.

    Raises:
        MissingLibraryError: scipy is not installed.
    """
    need("scipy", extra="exploration", asker="this strategy")
    return import_module(f"scipy.{part}")
