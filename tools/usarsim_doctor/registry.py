"""What a check is, and what it finds.

A check is a function that yields findings, entered with a decorator:

    @check("disk", "Disk", order=25)
    def look(context: Context) -> Iterator[Finding]:
        yield Finding("free space", Mark.OK, "12 GiB")
"""

from __future__ import annotations

import enum
import shlex
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from usarsim_server.settings import Settings


class Mark(enum.Enum):
    """How a thing stands.

    A note is neither good nor bad, for example something optional that is not there. With a warning
    the server runs, but not as well as it could; with a problem it does not start, or not as asked.
    """

    OK = "ok"
    NOTE = "note"
    WARNING = "warning"
    PROBLEM = "problem"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the report."""

    subject: str  # what was looked at, a word or two
    mark: Mark  # see there
    text: str  # what was found, and what it means
    cure: str | None = None  # the one command that mends it
    advice: str | None = None  # where no command does, what to do instead
    values: Mapping[str, object] = field(default_factory=dict)
    """The same in numbers, for machines; finite, and named with their units."""


@dataclass(frozen=True, slots=True)
class Context:
    """What checks may ask for."""

    settings: Settings  # those that the server would run with
    given: tuple[tuple[str, str], ...] = ()
    """Options of the command line that they came from, in order, flag and text."""

    def serve(self, options: Mapping[str, object]) -> str:
        """The command that starts the server with these settings but for some options."""
        words = ["usarsim", "serve"]
        kept = [(flag, text) for flag, text in self.given if flag not in options]
        for flag, text in [*kept, *((flag, str(value)) for flag, value in options.items())]:
            # Joined, a text that begins with a hyphen is no option.
            words += [f"{flag}={text}"] if text.startswith("-") else [flag, text]
        return shlex.join(words)


Look = Callable[[Context], Iterable[Finding]]


@dataclass(frozen=True, slots=True)
class Check:
    """One check."""

    key: str  # one word, for machines
    title: str  # for readers
    order: int  # place in the report; low numbers come first
    look: Look  # what it does
    apart: bool = False
    """It needs libraries that may be broken, and so runs in a process of its own."""


CHECKS: dict[str, Check] = {}
"""Those of all modules that are imported, by key."""


def check(key: str, title: str, order: int, *, apart: bool = False) -> Callable[[Look], Look]:
    """Decorator: enter a function as a check (see `Check`).

    Raises:
        ValueError: if another function has that key.
    """

    def enter(look: Look) -> Look:
        known = CHECKS.get(key)
        if known is not None and known.look.__module__ != look.__module__:
            raise ValueError(f"check {key!r} is already that of {known.look.__module__}")
        CHECKS[key] = Check(key, title, order, look, apart)
        return look

    return enter
