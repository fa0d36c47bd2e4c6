"""What a user of `usarsim explore` can do wrong; see `usarsim_server.errors`."""

from __future__ import annotations

from usarsim_server.errors import UsarsimError


class ExplorationError(UsarsimError):
    """A scenario, or a file that belongs to a run, cannot be used."""
