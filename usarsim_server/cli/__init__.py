"""The `usarsim` command: one file per subcommand, in this folder or named by an entry point.

A file of this folder whose docstring begins with "`usarsim NAME`: what it does." is a subcommand;
so is a module that a package names in the entry point group `usarsim.commands`. It defines
`add_parser(subparsers)`, which adds one parser and sets its default `run`, a function from the
parsed arguments to the exit code. Only the subcommand that is called is imported. An entry point
names the extra that brings its libraries, as in `film = "usarsim_operator.film.command [console]"`.
"""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import entry_points

from usarsim_server import __version__
from usarsim_server.base import streams
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.extras import missing
from usarsim_server.cli.parser import CommandParser, ProgramParser

__all__ = ["GROUP", "build_parser", "main"]

GROUP = "usarsim.commands"
"""Entry point group of subcommands: name and module."""

_INTERRUPTED = 130
"""Exit code of a shell command ended by Ctrl-C."""

_TITLE = re.compile(r'"""`usarsim (?P<name>[a-z-]+)`: (?P<help>[^\n]*?)\.?(?:"""|\n)')
"""How the docstring of a subcommand's module begins."""


def _commands() -> Iterator[tuple[str, str, str]]:
    """Name, one line of help and module of every subcommand; none of them is imported."""
    own = {entry.name for entry in pkgutil.iter_modules(__path__)}
    modules = {f"{__name__}.{name}" for name in own}
    modules |= {point.module for point in entry_points(group=GROUP)}
    for module in modules:
        try:
            spec = importlib.util.find_spec(module)
        except ImportError:
            continue
        if spec is None or spec.origin is None:
            continue
        with open(spec.origin, encoding="utf-8") as file:
            title = _TITLE.match(file.read(400))
        if title is not None:
            yield title["name"], title["help"], module


def build_parser(called: Iterable[str] | None = None) -> ProgramParser:
    """The parser of the command line; the documentation is made from it too.

    Args:
        called: the subcommands whose options are wanted; the others are named only. None stands
            for all.
    """
    parser = ProgramParser(
        prog="usarsim",
        description="Legacy USARSim robot controllers drive robots in a MuJoCo world.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "-V", "--version", action="version", version=f"usarsim-server {__version__}"
    )
    subparsers = parser.add_subparsers(
        title="commands", metavar="COMMAND", required=True, parser_class=CommandParser
    )
    wanted = None if called is None else set(called)
    for name, help, module in sorted(_commands()):
        if wanted is None or name in wanted:
            importlib.import_module(module).add_parser(subparsers)
        else:
            subparsers.add_parser(name, help=help)
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
    return streams.settle(_run(argv))


def _run(argv: Sequence[str] | None) -> int:
    words = list(sys.argv[1:] if argv is None else argv)
    if words[:1] == ["help"]:
        words = [*words[1:], "--help"]
    words = words or ["--help"]
    called = [word for word in words if not word.startswith("-")][:1]
    try:
        parser = build_parser(called)
        arguments, rest = parser.parse_known_args(words)
        if rest:
            parser.complain(words, rest)
        code: int = arguments.run(arguments)
    except ModuleNotFoundError as error:
        library = str(error.name).partition(".")[0]
        points = entry_points(group=GROUP).select(name=called[0]) if called else ()
        found = [extra for point in points for extra in point.extras]
        if not found or library.startswith("usarsim"):
            raise
        print(f"error: usarsim {called[0]}: {missing(library, found[0])}", file=sys.stderr)
        return 2
    except UsarsimError as error:
        if isinstance(error, streams.OutputError):
            streams.mute()
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return _INTERRUPTED
    except streams.ReaderGoneError:
        return 0
    except SystemExit as end:
        end.code = streams.settle(end.code if isinstance(end.code, int) else 1)
        raise
    return code
