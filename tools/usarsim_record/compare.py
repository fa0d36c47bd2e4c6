"""Compares what a server said with what another one says to the same controller."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from usarsim_record.digest import Digest, Series, Shape, numbers_of, shape_of, words_of

_LINES_MORE = 3.0
"""Lines of a stream by which two sessions may end at different moments, and by which a command may
have come sooner or later between two reports: the controller that was recorded raced as well."""
_STRAY = 1.5
"""Lines by which the counts of a stream may differ, whatever its rate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """What counts as equal.

    Attributes:
        relative: part of the larger number by which two may differ.
        absolute: by which two numbers may differ in any case.
        rate: part by which counts per simulated second of streamed lines may differ.
    """

    relative: float = 0.05
    absolute: float = 0.1
    rate: float = 0.1

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
