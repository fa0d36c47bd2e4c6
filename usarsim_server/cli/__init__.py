"""The `usarsim` command: one file per subcommand in this folder.

A file of this folder that defines `add_parser(subparsers)` is a subcommand; no list has to be
kept. `add_parser` adds one parser and sets its default `run`, a function from the parsed
arguments to the exit code. Heavy imports belong inside `run`, so that `--help` is quick.
"""

from __future__ import annotations

import argparse
import importlib
import os
import pkgutil
import sys
from collections.abc import Sequence

from usarsim_server import __version__
from usarsim_server.errors import UsarsimError

__all__ = ["build_parser", "main"]

_INTERRUPTED = 130
"""Exit code of a shell command ended by Ctrl-C."""


def build_parser() -> argparse.ArgumentParser:
    """The parser of the whole command line; the documentation is made from it too."""
    parser = argparse.ArgumentParser(
        prog="usarsim",
        description="Legacy USARSim robot controllers drive robots in a MuJoCo world.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"usarsim-server {__version__}")
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for entry in sorted(pkgutil.iter_modules(__path__), key=lambda entry: entry.name):
        if entry.name.startswith("_"):
            continue
        module = importlib.import_module(f"{__name__}.{entry.name}")
        add_parser = getattr(module, "add_parser", None)
        if add_parser is not None:
            add_parser(subparsers)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: arguments after the program name; those of the process by default.

    Returns:
        The exit code: 0, or 2 after one `error:` line on standard error.

    Raises:
        SystemExit: from argparse, after `--help` (code 0) or unknown arguments (code 2).
    """
    arguments = build_parser().parse_args(argv)
    try:
        code: int = arguments.run(arguments)
        sys.stdout.flush()
    except UsarsimError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BrokenPipeError:
        # `usarsim worlds | head`: the reader has seen enough. Standard output is pointed elsewhere
        # so that the flush at exit cannot fail again (Python library reference, signal, "Note on
        # SIGPIPE").
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return code
