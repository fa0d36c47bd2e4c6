"""Reading TOML files: whatever is wrong with one is one error that names the place and a cure."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

from usarsim_server.errors import UsarsimError, at

__all__ = ["finite", "read_toml"]


def finite(value: object) -> float | None:
    """A value of a TOML file as a finite number; None if it is none, or too large for one."""
    # bool is an int to Python, but not to whoever wrote `range = true`.
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:  # whole numbers may be as long as one likes
        return None
    return number if math.isfinite(number) else None


def read_toml(path: Path, error: type[UsarsimError], entry: str = "name") -> dict[str, object]:
    """Parse a TOML file.

    Args:
        path: the file.
        error: what is raised.
        entry: a list that such files have, for the cure.

    Raises:
        error: if it cannot be read or is not TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as cause:
        problem = f"cannot be read: {cause.strerror or cause}"
        raise error(at(path, problem, "check the path and its rights")) from cause
    except UnicodeDecodeError as cause:
        problem = f"byte {cause.start} is not UTF-8"
        raise error(at(path, problem, "save the file as UTF-8")) from cause
    except (ValueError, RecursionError) as cause:
        # Besides its own error tomllib lets those of int() and of the recursion limit through.
        problem, _, place = str(cause).partition(" (at ")
        cure = (
            "mend the line; TOML writes key = value, text in quotes, "
            f"[[{entry}]] for an entry of a list"
        )
        where = place.rstrip(")") or None
        raise error(at(path, f"is not valid TOML: {problem}", cure, where=where)) from cause
