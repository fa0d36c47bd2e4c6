"""From bytes to lines to commands: words and segments, nothing interpreted (protocol reference 1).

The grammar is the tolerant one of the reference: junk between segments is skipped, a broken segment
is dropped without hiding its neighbours, and a command glued behind a closing brace starts a
command of its own (protocol 1.4). Every function here runs in linear time and accepts any bytes.

Lines come out of bytes in any chunking (protocol 1.4): linear in the number of bytes, however small
the chunks are; memory is bounded by one line; a line that is too long is drained to its end and the
connection lives on.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from usarsim_server.protocol.values import Hearing, Segment

MOST_SEGMENTS = 1024
"""Segments of one line, those of commands glued to it and empty ones included; what follows them is
thrown away. A segment of three bytes takes sixty times as much memory. The longest command of known
clients, a MULTIDRIVE of all joints, has some thirty."""
WEIGHT_BYTES = 1024
"""Bytes of memory that make a command count as one more, see `Command.weight`."""
_SEGMENT_BYTES = 208
"""Memory of a segment beside its characters: a tuple, two texts, a place in a tuple."""
_COMMAND_BYTES = 512
"""Memory of a command beside its segments: the object, its word, the text for the log."""

IGNORED_WORDS = frozenset(
    {
        "CAMERA",
        "EFFECTOR",
        "FACTORY",
        "KILL",
        "PAUSE",
        "POSALL",
        "SENSOR",
        "SETBALL",
        "TEST",
        "TRACE",
        "TURN",
    }
)
"""Words that are accepted and have no effect here (protocol reference 3.12 and 3.15)."""

KNOWN_WORDS = IGNORED_WORDS | {
    "ACT",
    "CONTROL",
    "DRIVE",
    "GETCLOSESTPATHNODE",
    "GETCONF",
    "GETGEO",
    "GETPATHNODES",
    "GETSTARTPOSES",
    "GOTO",
    "INIT",
    "MISPKG",
    "MOVE",
    "MULTIDRIVE",
    "SET",
    "SYNC",
}
"""Command words of all server generations (protocol reference 3.1), and SYNC, our own.

Only these may start a glued command: RDK sends RFID requests without a terminator, the 2011
student controllers do so with other lines.
"""

_BLANKS = " \t"
_HEAD = re.compile(r"[ \t]*([A-Za-z0-9_]*)")
# A whole segment, a lone brace, or text outside braces. A brace that opens a segment never closed
# is scanned at most twice, so the tokenizer is linear.
_TOKEN = re.compile(r"\{([^{}]*)\}|[{}]|[^{}]+")
_NAME_END = re.compile(r"[ \t]+")
# Written by .NET stream writers in front of the first line.
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
# Enough to recognise a command in a log; a line may have 64 KiB.
_LOGGED_CHARACTERS = 200


@dataclass(frozen=True, slots=True)
class Command:
    """One command as it was written."""

    word: str  # command word in upper case; empty if the line has none
    segments: tuple[Segment, ...] = ()
    """Name and value of every well formed segment, in order, spelled as sent. The value keeps inner
    blanks; a segment of one word has an empty value. Empty segments are left out."""
    text: str = ""  # the beginning of the command, safe to print in a log
    weight: int = 1
    """Memory that it takes while it waits, in units of `WEIGHT_BYTES`, rounded up. That of a
    command of known clients is 1 to 4."""
    cut: bool = False  # what followed on its line was thrown away

    hearing: ClassVar[Hearing | None] = None
    """Takes notice of how the command is read; nobody does, see `explanation.HeardCommand`."""

    def get(self, name: str, default: str | None = None) -> str | None:
        """Value of the first segment of this name in any case, `default` if there is none."""
        return first_value(self.segments, name, default)

    def has(self, name: str) -> bool:
        """Whether a segment of this name exists, in any case."""
        return self.get(name) is not None


def first_value(segments: Iterable[Segment], name: str, default: str | None = None) -> str | None:
    """Value of the first segment of this name in any case, `default` if there is none."""
    wanted = name.lower()
    return next((value for key, value in segments if key.lower() == wanted), default)


def parse_line(line: bytes) -> list[Command]:
    """Read one line without its terminator; never raises.

    Bytes are taken as Latin-1, so that whatever a client's locale produced survives unchanged.

    Returns:
        The command of the line and those glued behind it, in order; nothing for a blank line. A
        line that has text but no command word gives a command with an empty word.
    """
    text = line.removeprefix(_BYTE_ORDER_MARK).decode("latin-1").strip(_BLANKS)
    if not text:
        return []
    head = _HEAD.match(text)
    assert head is not None  # the pattern matches the empty string
    commands: list[Command] = []
    word, start, segments = head[1].upper(), 0, list[Segment]()
    after_brace = cut = False
    end, left = len(text), MOST_SEGMENTS
    for token in _TOKEN.finditer(text, head.end()):
        inner = token[1]
        if inner is not None:
            if left == 0:
                end, cut = token.start(), True
                break
            left -= 1
            _append(segments, inner)
            after_brace = True
        elif token[0] in "{}":
            after_brace = token[0] == "}"
        elif after_brace and token[0] != " " and (glued := _glued_word(text, token)):
            commands.append(_command(word, segments, text, start, token.start()))
            word, start, segments = glued, token.start(), []
    commands.append(_command(word, segments, text, start, end, cut))
    return commands


def _command(
    word: str, segments: list[Segment], text: str, start: int, end: int, cut: bool = False
) -> Command:
    """The command that is `text[start:end]`."""
    memory = _COMMAND_BYTES + _SEGMENT_BYTES * len(segments) + (end - start)
    weight = -(-memory // WEIGHT_BYTES)
    return Command(word, tuple(segments), _loggable(text, start, end), weight, cut)


def _append(segments: list[Segment], inner: str) -> None:
    """Split the text of one segment at its first run of blanks; keep it unless it is empty."""
    name, _, value = inner.strip(_BLANKS).partition(" ")
    if "\t" in name:
        name, value = _NAME_END.split(inner.strip(_BLANKS), maxsplit=1)
    if name:
        segments.append((name, value.lstrip(_BLANKS)))


def _glued_word(text: str, token: re.Match[str]) -> str:
    """The command word that this text outside braces is, or nothing."""
    word = token[0].strip(_BLANKS).upper()
    follower = text[token.end() : token.end() + 1]
    return word if word in KNOWN_WORDS and follower != "}" else ""


def _loggable(text: str, start: int, end: int) -> str:
    """The beginning of `text[start:end]` with everything unprintable escaped."""
    shown = text[start : min(end, start + _LOGGED_CHARACTERS)].strip(_BLANKS)
    if not (shown.isascii() and shown.isprintable()):
        shown = shown.encode("unicode_escape").decode("ascii")
    if max(end - start, len(shown)) <= _LOGGED_CHARACTERS:
        return shown
    return shown[:_LOGGED_CHARACTERS] + "..."


MAX_LINE = 65536
"""Longest accepted line in bytes, terminator excluded.

The original server had no limit and its script buffer simply grew; protocol reference 1.4 asks for
at least this much. The longest line any known client sends is a CONTROL AddWP path of a few
kilobytes. For comparison: h11 allows 16 KiB of HTTP header, nginx four buffers of 8 KiB.
"""

_TERMINATOR = re.compile(rb"[\r\n]+")


class LineFramer:
    """Cuts one connection's bytes into lines.

    CR, LF and any run of them end a line, so CR LF, LF CR and blank lines all work; empty lines
    are skipped. A rest without terminator is held and never becomes a line by itself.

    Args:
        max_line: longest accepted line in bytes; a line of exactly this length passes.
    """

    __slots__ = ("_draining", "_held", "discarded", "max_line")

    def __init__(self, max_line: int = MAX_LINE) -> None:
        if max_line < 1:
            raise ValueError(f"max_line must be at least 1, not {max_line!r}")
        self.max_line = max_line
        self.discarded = 0
        """Number of lines thrown away because they were too long."""
        self._held = bytearray()
        self._draining = False

    @property
    def pending(self) -> int:
        """Bytes held of a line whose terminator has not arrived; at most `max_line`."""
        return len(self._held)

    def feed(self, data: bytes) -> list[bytes]:
        """Take the next bytes and return the lines they complete, without terminators."""
        lines: list[bytes] = []
        first, *others = _TERMINATOR.split(data)
        self._hold(first)
        for part in others:
            if self._held:
                lines.append(bytes(self._held))
                self._held.clear()
            self._draining = False
            self._hold(part)
        return lines

    def _hold(self, part: bytes) -> None:
        """Append a piece of the current line, or give the line up if it grows too long."""
        if self._draining:
            return
        if len(self._held) + len(part) <= self.max_line:
            self._held += part
            return
        self._held.clear()
        self._draining = True
        self.discarded += 1
