"""Structured log lines on standard error: `LEVEL area key=value message`.

Quiet by default. At `info` one sees the server start, connections and robots come and go; at
`debug` also what is unusual but harmless. Every line about a client names its connection, and
its robot once there is one:

    INFO control connection=127.0.0.1:50122 robot=Rover7 client closed the connection

Clients decide how often some lines are due, so lines of one kind are limited: `BURST` at once, then
`RATE` a second. The next line of that kind says how many were left out. Nothing is left out at
`debug`.
"""

from __future__ import annotations

import contextlib
import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import TextIO

ROOT = "usarsim"
"""Name of the logger that all areas hang under; tests and embedders may attach to it."""

LEVELS = {
    "debug": logging.DEBUG,
    "info": logging.INFO,
    "warning": logging.WARNING,
    "error": logging.ERROR,
}
"""Names that `--log-level` takes."""

BURST = 100
"""Lines of one kind that may come at once: more than there are robots."""
RATE = 2.0
"""Lines of one kind per second of wall time that are written in the long run."""


class _Ears(threading.local):
    """Who listens to what this thread says."""

    heard: list[str] | None = None
    unwritten: bool = False  # only lines that are not written


_ears = _Ears()


@contextlib.contextmanager
def overheard(*, unwritten: bool = False) -> Iterator[list[str]]:
    """All that this thread says inside, whatever the level: message and facts, in plain words.

    So a client can be told why its command did nothing, in the words of those who know.

    Args:
        unwritten: only what is below the level of the log.
    """
    before = _ears.heard, _ears.unwritten
    _ears.heard, _ears.unwritten = [], unwritten
    try:
        yield _ears.heard
    finally:
        _ears.heard, _ears.unwritten = before


_FACTS = "usarsim_facts"
_LEFT_OUT = "usarsim_left_out"
_MAX_KINDS = 1000
_MOST_HEARD = 16
# Characters of one value, and of a message: clients choose what they say, not our line length.
_MAX_VALUE = 200
_MAX_MESSAGE = 1000


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

    @property
    def is_heard(self) -> bool:
        """Whether `debug` lines are written or overheard; a costly hint is made only then."""
        return _ears.heard is not None or self._logger.isEnabledFor(logging.DEBUG)

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
        written = self._logger.isEnabledFor(level)
        heard = None if written and _ears.unwritten else _ears.heard
        if heard is not None and len(heard) < _MOST_HEARD:
            heard.append(_told(message, facts))
        if not written:
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
        message = record.getMessage()
        if len(message) > _MAX_MESSAGE:
            message = message[:_MAX_MESSAGE] + "..."
        line = " ".join([record.levelname, area, *pairs, _printable(message)])
        if left_out := getattr(record, _LEFT_OUT, 0):
            line += f" ({left_out} lines like this one were left out)"
        if record.exc_info and record.exc_info[0] is not None:
            line += "\n" + self.formatException(record.exc_info)
        return line


class Moderation(logging.Filter):
    """Leaves out lines of a kind that comes too often: a token bucket for each kind.

    Of one kind are lines of one area and level that begin alike, up to the first colon; what
    follows, and the facts, tell one case from another.

    Attributes:
        burst: lines of one kind that may come at once.
        rate: lines of one kind per second in the long run.
    """

    def __init__(
        self,
        burst: int = BURST,
        rate: float = RATE,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__()
        self.burst, self.rate, self._clock = burst, rate, clock
        self._kinds: dict[tuple[str, int, str], tuple[float, float, int]] = {}
        self._lock = threading.Lock()  # threads ask at the same time

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a line may be written; it is told how many like it were not."""
        if record.levelno <= logging.DEBUG:
            return True
        kind = record.name, record.levelno, record.getMessage()[:_MAX_MESSAGE].partition(":")[0]
        now = self._clock()
        with self._lock:
            if len(self._kinds) >= _MAX_KINDS:
                self._kinds.clear()
            left, then, missing = self._kinds.get(kind, (float(self.burst), now, 0))
            left = min(float(self.burst), left + (now - then) * self.rate)
            passes = left >= 1.0
            self._kinds[kind] = (left - 1.0, now, 0) if passes else (left, now, missing + 1)
        if passes and missing:
            setattr(record, _LEFT_OUT, missing)
        return passes


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
    if LEVELS[level] > logging.DEBUG:
        handler.addFilter(Moderation())
    root.addHandler(handler)
    # Libraries only ever speak of trouble here; the chosen level is for our own areas.
    root.setLevel(logging.WARNING)
    logging.getLogger(ROOT).setLevel(LEVELS[level])


def _told(message: str, facts: Mapping[str, object]) -> str:
    """A message with its own facts, without those that stand on every line."""
    pairs = [f"{key} {_value(value)}" for key, value in facts.items() if value is not None]
    text = _printable(message[:_MAX_MESSAGE])
    return f"{text} ({', '.join(pairs)})" if pairs else text


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
