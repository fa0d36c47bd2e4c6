"""What a server says on a connection, in a form that can be compared."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from usarsim_record.session_clock import time_told

STREAMED = frozenset({"SEN", "STA", "MISSTA"})
"""Heads of lines that come by themselves, again and again."""

_FLEETING = frozenset({"Time", "Port"})

_MOST_LINES = 20_000
"""Replies remembered of one kind."""
_MOST_SHAPES = 100
_MOST_HELD = 1 << 20
"""Bytes of a line; more is no line."""
_HEADER = 5
_LARGEST = 1 << 28

_BODY = re.compile(r"\{([^{}]*)\}")
_TYPE = re.compile(r"\{Type ([^{}]*)\}")
_NAME = re.compile(r"\{Name ([^{} ]*)")
_WORD = re.compile(r"[^ ,]+")
_INTEGER = re.compile(r"[+-]?\d+")
_FLOAT = re.compile(r"[+-]?\d*\.(\d*)([eE][+-]?\d+)?")

Shape = tuple[str, ...]
"""Form of a line: what stands between segments, their names, and the kinds of their values."""


def shape_of(line: str) -> Shape:
    """Form of a line, with all values left out."""
    parts: list[str] = []
    place = 0
    for match in _BODY.finditer(line):
        parts.append(line[place : match.start()])
        name, _, value = match[1].partition(" ")
        parts.append(f"{{{name} {_kinds(value)}}}")
        place = match.end()
    parts.append(line[place:])
    return tuple(parts)


def _kinds(value: str) -> str:
    """Kinds of the words of a value; equal neighbours in a list are counted, not repeated."""
    found: list[str] = []
    for part in value.split(" "):
        kinds = [_kind(word) for word in part.split(",")] if part else [""]
        if len(kinds) > 1:
            found.append(",".join(f"{kind}x{count}" for kind, count in _runs(kinds)))
        else:
            found.extend(kinds)
    return " ".join(found)


def _runs(kinds: list[str]) -> Iterator[tuple[str, int]]:
    count = 0
    for index, kind in enumerate(kinds):
        count += 1
        if index + 1 == len(kinds) or kinds[index + 1] != kind:
            yield kind, count
            count = 0


def _kind(word: str) -> str:
    if _INTEGER.fullmatch(word):
        return "int"
    match = _FLOAT.fullmatch(word)
    return f"float{len(match[1])}" if match else "word"


def numbers_of(line: str) -> list[float]:
    """All numbers in the values of a line, but for those that never repeat: times and ports."""
    found: list[float] = []
    for body in _BODY.findall(line):
        name, _, value = body.partition(" ")
        if name not in _FLEETING:
            found.extend(
                float(word)
                for word in _WORD.findall(value)
                if _INTEGER.fullmatch(word) or _FLOAT.fullmatch(word)
            )
    return found


def words_of(line: str) -> list[str]:
    """All words in the values of a line that are no numbers."""
    return [
        word
        for body in _BODY.findall(line)
        for word in _WORD.findall(body.partition(" ")[2])
        if _kind(word) == "word"
    ]


@dataclass
class Series:
    """Lines, or pictures, of one kind on one connection.

    Attributes:
        streamed: whether they come by themselves.
        count: how many.
        first: simulated s of the first one after a time was told. last: of the last one.
        timed: how many came since then.
        shapes: how often each form was seen.
        lines: the lines, of those that are not streamed.
        lowest: of each number of a line of the form seen first. highest: likewise.
        step: the largest change of each from one line to the next.
        latest: numbers of the last line of that form.
    """

    streamed: bool
    count: int = 0
    first: float = 0.0
    last: float = 0.0
    timed: int = 0
    shapes: Counter[Shape] = field(default_factory=Counter)
    lines: list[str] = field(default_factory=list)
    lowest: list[float] = field(default_factory=list)
    highest: list[float] = field(default_factory=list)
    step: list[float] = field(default_factory=list)
    latest: list[float] = field(default_factory=list)

    @property
    def rate(self) -> float:
        """Per simulated second, 0 with fewer than two."""
        return (self.timed - 1) / (self.last - self.first) if self.last > self.first else 0.0

    @property
    def usual(self) -> Shape:
        """The form seen most often."""
        return self.shapes.most_common(1)[0][0] if self.shapes else ()

    def add(self, line: str, time: float | None) -> None:
        """Take a line that came when this simulated time had been told."""
        self.count += 1
        if time is not None:
            self.first = time if not self.timed else self.first
            self.last = time
            self.timed += 1
        shape = shape_of(line)
        if shape in self.shapes or len(self.shapes) < _MOST_SHAPES:
            self.shapes[shape] += 1
        if not self.streamed:
            if len(self.lines) < _MOST_LINES:
                self.lines.append(line)
            return
        values = numbers_of(line)
        if not self.latest:
            self.lowest, self.highest = list(values), list(values)
            self.step, self.latest = [0.0] * len(values), values
        if len(values) == len(self.lowest):
            self.lowest = list(map(min, self.lowest, values))
            self.highest = list(map(max, self.highest, values))
            steps = [abs(now - then) for now, then in zip(values, self.latest, strict=True)]
            self.step = list(map(max, self.step, steps))
            self.latest = values


class Digest:
    """Takes a server's bytes and sorts them; memory stays bounded for streams.

    A connection carries lines until bytes come that are no text; those are image replies if they
    can be read as such (side channels reference 2.3), or else only counted.

    Attributes:
        series: by kind: head and Type of a line, with Name where it is streamed; `picture`.
        heads: how many lines came of each head; `picture` for image replies.
        bytes: in all.
        ended: whether the server hung up.
    """

    def __init__(self) -> None:
        self.series: dict[str, Series] = {}
        self.heads: Counter[str] = Counter()
        self.bytes = 0
        self.ended = False
        self._held = b""
        self._mode = ""
        self._time: float | None = None

    @property
    def binary(self) -> bool:
        """Whether what came is neither lines nor pictures."""
        return self._mode == "bytes"

    def feed(self, data: bytes) -> None:
        """Take bytes that came."""
        if not data:
            return
        self.bytes += len(data)
        if not self._mode:
            # Of a picture's header the first byte is a small number, and so is the second.
            self._mode = "pictures" if data[0] < 9 else "lines"
        self._held += data
        if self._mode == "pictures":
            self._take_pictures()
        elif self._mode == "lines":
            self._take_lines()
        else:
            self._held = b""

    def needed(self) -> Counter[str]:
        """What a controller may have waited for: every reply, and the first of each stream."""
        return Counter(
            {
                head: min(count, 1) if head in STREAMED else count
                for head, count in self.heads.items()
            }
        )

    def _take_lines(self) -> None:
        *lines, self._held = self._held.split(b"\n")
        for line in lines:
            told = time_told(line)
            self._time = self._time if told is None else told
            self._add_line(line.decode("latin-1").removesuffix("\r"))
        if len(self._held) > _MOST_HELD:
            self._mode, self._held = "bytes", b""

    def _add_line(self, line: str) -> None:
        head = line.partition("{")[0].strip() or ("{}" if line else "(empty line)")
        streamed = head in STREAMED
        kind = head
        if match := _TYPE.search(line):
            kind = f"{kind} {match[1]}"
        if streamed and head == "SEN" and (match := _NAME.search(line)):
            kind = f"{kind} {match[1]}"
        self.heads[head] += 1
        self._series(kind, streamed).add(line, self._time)

    def _take_pictures(self) -> None:
        while len(self._held) >= _HEADER:
            length = int.from_bytes(self._held[1:_HEADER])
            if length > _LARGEST:
                self._mode, self._held = "bytes", b""
                return
            if len(self._held) < _HEADER + length:
                return
            kind, payload = self._held[0], self._held[_HEADER : _HEADER + length]
            self._held = self._held[_HEADER + length :]
            self.heads["picture"] += 1
            self._series("picture", False).add(_described(kind, payload), None)

    def _series(self, kind: str, streamed: bool) -> Series:
        return self.series.setdefault(kind, Series(streamed))


def _described(kind: int, payload: bytes) -> str:
    """A picture as a line that can be compared: what two servers must agree on."""
    if kind == 0:
        width, height = (int.from_bytes(payload[place : place + 2]) for place in (0, 2))
        return f"picture {{Type {kind}}} {{Size {width},{height}}} {{Bytes {len(payload)}}}"
    state = "empty" if not payload else "JPEG" if payload[:2] == b"\xff\xd8" else "no-JPEG"
    return f"picture {{Type {kind}}} {{Payload {state}}}"
