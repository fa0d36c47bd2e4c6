"""A strategy out of a file that nobody has installed: `my.py:Name`."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import is_dataclass
from pathlib import Path

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.strategy import Strategy
from usarsim_server.base.errors import at
from usarsim_server.base.files import is_regular
from usarsim_server.base.tables import suggest

_CURE = "see docs/howto/strategy.md"


def split(name: str) -> tuple[Path, str] | None:
    """File and class, if a name means such a strategy; the class may be left out."""
    file, _, cls = name.rpartition(":")
    if not file and name.endswith(".py"):
        file, cls = name, ""
    return (Path(file), cls) if file.endswith(".py") else None


def load_strategy(path: Path, name: str) -> type[Strategy]:
    """The class of a file.

    The file is run, as the user who names it wants: it is a program.

    Args:
        path: of the file. name: of the class; empty: the only strategy in there.

    Raises:
        ExplorationError: there is no such file or class, or the file cannot be run.
    """
    if not is_regular(path):
        raise ExplorationError(at(path, "no such file", "write FILE.py:CLASS"))
    module_name = f"usarsim_strategy_{path.stem}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # dataclasses look there for what annotations mean
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        line = _line(error, path)
        problem = f"{type(error).__name__}: {error}"
        raise ExplorationError(at(path, problem, "mend the file", where=line)) from error
    found = {
        key: value
        for key, value in vars(module).items()
        if isinstance(value, type)
        and issubclass(value, Strategy)
        and value.__module__ == module_name
    }
    if not name and len(found) == 1:
        name = next(iter(found))
    if name not in found:
        problem = f"there is no strategy {name!r}" if name else f"there are {len(found)} strategies"
        raise ExplorationError(at(path, problem, suggest(name, sorted(found)) if name else _CURE))
    if not is_dataclass(found[name]):
        raise ExplorationError(at(path, "it is no dataclass", f"write @dataclass; {_CURE}"))
    return found[name]


def _line(error: BaseException, path: Path) -> str | None:
    """Where in the file it went wrong."""
    if isinstance(error, SyntaxError):
        return f"line {error.lineno}"
    last, trace = None, error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(path):
            last = f"line {trace.tb_lineno}"
        trace = trace.tb_next
    return last
