"""What a user of `usarsim explore` can do wrong; see `usarsim_server.errors`."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from usarsim_server.errors import UsarsimError


class ExplorationError(UsarsimError):
    """A scenario, or a file that belongs to a run, cannot be used."""


def scipy(part: str) -> Any:
    """A part of scipy, which only some strategies need.

    Args:
        part: such as `optimize`.

    Raises:
        ExplorationError: scipy is not installed.
    """
    try:
        return import_module(f"scipy.{part}")
    except ImportError as error:
        cure = "pip install usarsim-server[exploration]"
        raise ExplorationError(f"scipy is not installed ({cure})") from error
