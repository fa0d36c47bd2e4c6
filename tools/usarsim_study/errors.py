"""The error of a study's files, and the one of a missing extra."""

from __future__ import annotations

import importlib.util

from usarsim_server.errors import UsarsimError


class StudyError(UsarsimError):
    """A study file, a study folder or a form cannot be used as it is."""


def need_extra(extra: str = "study") -> None:
    """Make sure that what judges studies is installed.

    Args:
        extra: which one brings it.

    Raises:
        UsarsimError: scipy or matplotlib is not.
    """
    for name in ("scipy", "matplotlib"):
        if importlib.util.find_spec(name) is None:
            raise UsarsimError(f"{name} is not installed (pip install usarsim-server[{extra}])")
