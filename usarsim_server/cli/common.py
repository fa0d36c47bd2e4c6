"""What several subcommands share: making their parsers, printing tables, writing files."""

from __future__ import annotations

import argparse
import shutil
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, TypeAlias

from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.files import replacing

Subparsers: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""What `add_parser` of a subcommand is given."""


def add_command(
    subparsers: Subparsers,
    name: str,
    help: str,
    run: Callable[[argparse.Namespace], int],
    *,
    epilog: str | None = None,
) -> argparse.ArgumentParser:
    """Add the parser of a subcommand.

    Args:
        subparsers: as given to `add_parser`.
        name: of the subcommand.
        help: one line without a full stop, for the list of commands.
        run: does the work and returns the exit code.
        epilog: below the options in `--help`.
    """
    parser = subparsers.add_parser(
        name,
        help=help,
        description=help[:1].upper() + help[1:] + ".",
        epilog=epilog,
        allow_abbrev=False,
    )
    parser.set_defaults(run=run)
    return parser


@contextmanager
def written(path: Path) -> Iterator[BinaryIO]:
    """A file to write to, see `files.replacing`.

    Raises:
        UsarsimError: it cannot be written.
    """
    try:
        with replacing(path) as file:
            yield file
    except OSError as error:
        cure = "name a file in a folder that exists"
        raise UsarsimError(at(path, f"cannot be written: {error.strerror}", cure)) from error


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Columns padded to their widest cell; numbers stand to the right, the last column is free."""
    rows = [list(row) for row in rows]
    cells = [list(heads), *([str(cell) for cell in row] for row in rows)]
    right = [
        bool(rows) and all(isinstance(row[column], int | float) for row in rows)
        for column in range(len(heads))
    ]
    widths = [max(len(line[column]) for line in cells) for column in range(len(heads))]
    lines = []
    for line in cells:
        padded = [
            cell.rjust(width) if to_right else cell.ljust(width)
            for cell, width, to_right in zip(line, widths, right, strict=True)
        ]
        lines.append("  ".join(padded).rstrip())
    return "\n".join(lines)


def facts(pairs: Iterable[tuple[str, object]]) -> str:
    """One `name   value` per line, values aligned."""
    pairs = [(name, str(value)) for name, value in pairs]
    width = max((len(name) for name, _ in pairs), default=0)
    return "\n".join(f"{name.ljust(width)}  {value}".rstrip() for name, value in pairs)


def paragraph(text: str) -> str:
    """Text wrapped to the terminal, at most 100 columns."""
    width = min(100, shutil.get_terminal_size().columns)
    return "\n\n".join(
        textwrap.fill(" ".join(part.split()), width) for part in text.strip().split("\n\n")
    )


def numbers(values: Iterable[float], digits: int = 2) -> str:
    """Numbers joined by commas, as a command line of the protocol takes them."""
    return ",".join(number(value, digits) for value in values)


def number(value: float, digits: int = 2) -> str:
    """A number without trailing zeros, and never a negative zero."""
    text = f"{value:.{digits}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
