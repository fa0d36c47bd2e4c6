"""The few errors that a user can meet; each says what, where, and how to mend it."""

from __future__ import annotations

from pathlib import Path

LONGEST_PATH = 500
"""Characters of a path in an error; systems allow 4095."""


class UsarsimError(Exception):
    """Base of all errors that are reported to a user in one line (exit code 2), no traceback.

    Attributes:
        spot: keys and numbers from 0 that lead to what is wrong in a file; empty if that is not
            known.
    """

    spot: tuple[str | int, ...] = ()


class SettingsError(UsarsimError):
    """A command line option or a key of the settings file is wrong."""


class WorldError(UsarsimError):
    """A world folder is missing, incomplete or inconsistent."""


class MapImportError(WorldError):
    """A map of another program cannot be imported."""


class RobotDescriptionError(UsarsimError):
    """A robot file cannot be used."""


class SpawnError(UsarsimError):
    """A robot could not be placed in the world (no free slot, silly pose, unknown class)."""


class ServiceError(UsarsimError):
    """A service cannot run, for example because its port is taken."""


def at(path: Path | str, problem: str, cure: str, *, where: str | None = None) -> str:
    """Return the one-line form of a file error: `path: where: problem (cure)`.

    Args:
        path: the file the user has to open; of absurdly long ones the end is left out.
        problem: what is wrong, with the offending value.
        cure: what to write instead.
        where: the key or line inside the file, if known.
    """
    place = _shown(path)
    if where:
        place = f"{place}: {where}"
    return f"{place}: {problem} ({cure})"


def problem_and_advice(message: str) -> tuple[str, str | None]:
    """Split an error meant for users into what is wrong and what is in the brackets at its end.

    The opposite of `at`; a message without brackets at its end has no advice.
    """
    text = " ".join(message.split())
    depth = 0
    for place in reversed(range(len(text) if text.endswith(")") else 0)):
        depth += {")": 1, "(": -1}.get(text[place], 0)
        if depth == 0:
            advice = text[place + 1 : -1].removeprefix("cure: ")
            return text[:place].rstrip(), advice or None
    return text, None


def plain(text: str) -> str:
    """A text with paths in it, without the bytes that Python keeps of names of files which the
    locale has no letters for: as UTF-8, or as a mark."""
    try:
        return text.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
    except UnicodeEncodeError:  # halves of letters, which no name of a file has
        return text.encode("utf-8", "replace").decode()


def _shown(path: Path | str) -> str:
    """A path on one line."""
    text = "".join(char if char.isprintable() else "?" for char in plain(str(path)))
    return text if len(text) <= LONGEST_PATH else text[:LONGEST_PATH] + "..."
