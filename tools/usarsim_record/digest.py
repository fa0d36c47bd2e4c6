"""What a server says on a connection, in a form that is compared with what another one says to the
same controller."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from usarsim_record.recording import time_told

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


_LINES_MORE = 3.0
"""Lines of a stream by which two sessions may end at different moments, and by which a command may
have come sooner or later between two reports: the controller that was recorded raced as well."""
_STRAY = 1.5
"""Lines by which the counts of a stream may differ, whatever its rate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """What counts as equal."""

    relative: float = 0.05  # part of the larger number by which two may differ
    absolute: float = 0.1  # by which two numbers may differ in any case
    rate: float = 0.1  # part by which counts per simulated second of streamed lines may differ

    def equal(self, one: float, other: float) -> bool:
        """Whether two numbers are equal enough; angles may be a turn apart."""
        margin = max(self.absolute, self.relative * max(abs(one), abs(other)))
        return any(abs(one - turned) <= margin for turned in _turns(other))

    def inside(self, value: float, low: float, high: float) -> bool:
        """Whether a number lies in a range, or near it; angles may be a turn apart."""
        margin = max(self.absolute, self.relative * max(abs(low), abs(high)))
        return any(low - margin <= turned <= high + margin for turned in _turns(value))


def _turns(value: float) -> tuple[float, ...]:
    """A number, and the same angle a turn away: 0 and 6.28 are one heading, and noise jumps."""
    if abs(value) > math.tau + 0.01:
        return (value,)
    return (value, value - math.tau, value + math.tau)


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One line of the table of verdicts.

    Attributes:
        connection: number of the connection.
        kind: of lines that are compared.
        recorded: how many there were. replayed: how many there are now.
        difference: what differs, empty if nothing.
    """

    connection: int
    kind: str
    recorded: int
    replayed: int
    difference: str = ""

    @property
    def passed(self) -> bool:
        """Whether they agree."""
        return not self.difference


def compare(connection: int, recorded: Digest, replayed: Digest, tolerance: Tolerance) -> list[Row]:
    """Rows of one connection, one for each kind of lines and one for its end if that differs."""
    rows = []
    for kind in [*recorded.series, *(new for new in replayed.series if new not in recorded.series)]:
        one, other = recorded.series.get(kind), replayed.series.get(kind)
        differences = _differences(one, other, tolerance)
        rows.append(
            Row(
                connection=connection,
                kind=kind,
                recorded=one.count if one else 0,
                replayed=other.count if other else 0,
                difference=next(differences, ""),
            )
        )
    if recorded.binary or replayed.binary:
        same = recorded.binary == replayed.binary
        rows.append(
            Row(
                connection=connection,
                kind="other bytes",
                recorded=recorded.bytes,
                replayed=replayed.bytes,
                difference="" if same else "text or pictures on one side, other bytes on the other",
            )
        )
    if recorded.ended != replayed.ended:
        rows.append(
            Row(
                connection=connection,
                kind="end of connection",
                recorded=int(recorded.ended),
                replayed=int(replayed.ended),
                difference="the server hung up by itself "
                + ("then, not now" if recorded.ended else "now, not then"),
            )
        )
    return rows


def _differences(one: Series | None, other: Series | None, allowed: Tolerance) -> Iterator[str]:
    if other is None:
        yield "never came"
    elif one is None:
        # One stray line of a stream may come or not, at the end of a session.
        if not other.streamed or other.count > 1:
            yield "did not come then"
    elif one.streamed:
        yield from _streams(one, other, allowed)
    else:
        yield from _replies(one, other, allowed)


def _streams(one: Series, other: Series, allowed: Tolerance) -> Iterator[str]:
    if one.usual != other.usual and one.usual not in other.shapes:
        yield _shapes_differ(one.usual, other.usual)
    if min(one.timed, other.timed) > 4 and one.rate:
        expected = one.rate * (other.last - other.first) + 1.0
        if abs(other.timed - expected) > _STRAY + allowed.rate * expected:
            yield f"{one.rate:.2f} a second then, {other.rate:.2f} now"
    if len(one.lowest) == len(other.lowest):
        for place in range(len(one.lowest)):
            yield from _courses(place, one, other, allowed)


def _courses(place: int, one: Series, other: Series, allowed: Tolerance) -> Iterator[str]:
    """A number has to go as far as it went then, and no farther."""
    margin = _LINES_MORE * max(one.step[place], other.step[place])
    then, now = ((side.lowest[place], side.highest[place]) for side in (one, other))
    for these, those in ((then, now), (now, then)):
        low, high = these[0] - margin, these[1] + margin
        if not all(allowed.inside(value, low, high) for value in those):
            yield (
                f"number {place + 1} goes from {now[0]:g} to {now[1]:g}, "
                f"was {then[0]:g} to {then[1]:g}"
            )
            return


def _replies(one: Series, other: Series, allowed: Tolerance) -> Iterator[str]:
    if one.count != other.count:
        yield f"{one.count} then, {other.count} now"
    for number, (then, now) in enumerate(zip(one.lines, other.lines, strict=False), start=1):
        yield from _lines(number, then, now, allowed)


def _lines(number: int, then: str, now: str, allowed: Tolerance) -> Iterator[str]:
    if shape_of(then) != shape_of(now):
        yield f"no. {number}: {_shapes_differ(shape_of(then), shape_of(now))}"
        return
    for one, other in zip(words_of(then), words_of(now), strict=True):
        if one != other:
            yield f"no. {number}: {one!r} then, {other!r} now"
    for one_value, other_value in zip(numbers_of(then), numbers_of(now), strict=True):
        if not allowed.equal(one_value, other_value):
            yield f"no. {number}: {one_value:g} then, {other_value:g} now"


def _shapes_differ(one: Sequence[str], other: Shape) -> str:
    for then, now in zip(one, other, strict=False):
        if then != now:
            return f"form {then!r} then, {now!r} now"
    longer, when = (one, "then") if len(one) > len(other) else (other, "now")
    return f"{''.join(longer[min(len(one), len(other)) :])!r} at the end {when} only"
