"""The error of a study's files."""

from __future__ import annotations

from usarsim_server.errors import UsarsimError


class StudyError(UsarsimError):
    """A study file, a study folder or a form cannot be used as it is."""
