"""Structured log lines on standard error: `LEVEL area key=value message`.

Quiet by default. At `info` one sees the server start, connections and robots come and go; at
`debug` also what is unusual but harmless. Every line about a client names its connection, and
its robot once there is one:

    INFO control connection=127.0.0.1:50122 robot=Rover7 client closed the connection
"""

from __future__ import annotations

import logging
import sys
from typing import TextIO

__all__ = ["LEVELS", "ROOT", "Log", "configure"]

ROOT = "usarsim"
"""Name of the logger that all areas hang under; tests and embedders may attach to it."""

LEVELS = {
    "debug": logging.DEBUG,
    "info": logging.INFO,
    "warning": logging.WARNING,
    "error": logging.ERROR,
}
"""Names that `--log-level` takes."""

_FACTS = "usarsim_facts"
_MAX_VALUE = 200  # characters of one value; a client chooses robot names, not our line length


class Log:
    """A source of log lines of one area, with facts that stand on each of them.

    Thread-safe and cheap to make; `bind` returns a new one and leaves the old one alone.
    """

    __slots__ = ("_area", "_facts", "_logger")

    def __init__(self, area: str, **facts: object) -> None:
        self._area = area
        self._facts = facts
        self._logger = logging.getLogger(f"{ROOT}.{area}")

    def bind(self, **facts: object) -> Log:
        """The same area with further facts on every line, for example `connection` or `robot`."""
        return Log(self._area, **{**self._facts, **facts})

    def debug(self, message: str, **facts: object) -> None:
        """Say what only a developer wants to know."""
        self._write(logging.DEBUG, message, facts)

    def info(self, message: str, **facts: object) -> None:
        """Say what an operator may want to know: start, connections, spawns."""
        self._write(logging.INFO, message, facts)

    def warning(self, message: str, **facts: object) -> None:
        """Say what is probably not what the operator intended."""
        self._write(logging.WARNING, message, facts)

    def error(self, message: str, **facts: object) -> None:
        """Say what failed."""
        self._write(logging.ERROR, message, facts)

    def exception(self, message: str, error: BaseException, **facts: object) -> None:
        """Report a defect of the server itself, with its traceback."""
        self._write(logging.ERROR, message, facts, error)

    def _write(
        self,
        level: int,
        message: str,
        facts: dict[str, object],
        error: BaseException | None = None,
    ) -> None:
        if not self._logger.isEnabledFor(level):
            return
        extra = {_FACTS: {**self._facts, **facts}}
        self._logger.log(level, "%s", message, extra=extra, exc_info=error)


class LineFormatter(logging.Formatter):
    """Renders a record as `LEVEL area key=value message`; text of clients cannot break the line."""

    def format(self, record: logging.LogRecord) -> str:
        """One line, followed by a traceback only where the server itself is at fault."""
        facts: dict[str, object] = getattr(record, _FACTS, {})
        area = record.name.removeprefix(f"{ROOT}.")
        pairs = [f"{key}={_value(value)}" for key, value in facts.items()]
        line = " ".join([record.levelname, area, *pairs, _printable(record.getMessage())])
        if record.exc_info and record.exc_info[0] is not None:
            line += "\n" + self.formatException(record.exc_info)
        return line


def configure(level: str, stream: TextIO | None = None) -> None:
    """Send log lines of this level and above to a stream; may be called again.

    Args:
        level: a name of `LEVELS`.
        stream: where to; standard error by default.
    """
    root = logging.getLogger()
    for handler in list(root.handlers):
        if isinstance(handler.formatter, LineFormatter):
            root.removeHandler(handler)
    handler = logging.StreamHandler(stream if stream is not None else sys.stderr)
    handler.setFormatter(LineFormatter())
    root.addHandler(handler)
    # Libraries only ever speak of trouble here; the chosen level is for our own areas.
    root.setLevel(logging.WARNING)
    logging.getLogger(ROOT).setLevel(LEVELS[level])


def _value(value: object) -> str:
    text = f"{value:g}" if isinstance(value, float) else str(value)
    if len(text) > _MAX_VALUE:
        text = text[:_MAX_VALUE] + "..."
    if text and not any(character in ' "=\\' for character in text) and text.isprintable():
        return text
    escaped = _printable(text.replace("\\", "\\\\")).replace('"', '\\"')
    return f'"{escaped}"'


def _printable(text: str) -> str:
    """The text with every control character escaped, so that one record stays one line."""
    if text.isprintable():
        return text
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode()
        for character in text
    )
