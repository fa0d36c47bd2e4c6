"""What a user of missions can do wrong; see `usarsim_server.base.errors`."""

from __future__ import annotations

from usarsim_server.base.errors import UsarsimError


class MissionError(UsarsimError):
    """A mission, or a file that belongs to one, cannot be used."""


class ScoringError(MissionError):
    """A scoring file cannot be used."""


class RunLogError(MissionError):
    """The folder of a run cannot be read or written."""
