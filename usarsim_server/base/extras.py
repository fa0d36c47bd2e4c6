"""The one line about a library that an extra of this distribution brings."""

from __future__ import annotations

import importlib.util

from usarsim_server.base.errors import UsarsimError


class MissingLibraryError(UsarsimError, ImportError):
    """A library that an extra brings is not installed."""


def missing(library: str, extra: str) -> str:
    """The sentence that tells a user to install a library.

    Args:
        library: top-level module. extra: name of the extra that brings it.
    """
    return f"{library} is not installed ({install(extra)})"


def install(extra: str) -> str:
    """The command that installs what an extra brings."""
    return f'pip install "usarsim-server[{extra}]"'


def need(*libraries: str, extra: str, asker: str) -> None:
    """Check that libraries are installed, without importing them.

    Args:
        libraries: top-level modules. extra: name of the extra that brings all of them.
        asker: what needs them, such as `the console`.

    Raises:
        MissingLibraryError: one of them is not installed.
    """
    for library in libraries:
        if importlib.util.find_spec(library) is None:
            raise MissingLibraryError(f"{asker}: {missing(library, extra)}", name=library)
