"""The outbox: two planes in one order, whole lines, bounded, woken once per burst."""

from __future__ import annotations

import sys
import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_server.base.token_bucket import TokenBucket
from usarsim_server.sessions.outbox import (
    GRACE,
    GRACE_SHARE,
    LEAST_READ,
    TOGETHER,
    Grace,
    Outbox,
    OutboxLimits,
)
from usarsim_server.testing import PATIENCE

STREAM_BYTES = 100
STREAM_LINES = 6
SMALL = OutboxLimits(STREAM_BYTES, STREAM_LINES, reply_bytes=200, reply_lines=5)
ENDLESS_REPLIES = OutboxLimits(STREAM_BYTES, STREAM_LINES, reply_bytes=10**9, reply_lines=10**9)


def drain(outbox: Outbox) -> list[bytes]:
    """Everything that waits, in order."""
    lines = []
    while (line := outbox.take()) is not None:
        lines.append(line)
    return lines


def numbered(head: str, number: int, length: int = 0) -> bytes:
    """A line that can be told from all others, at least so long."""
    return f"{head} {{Time {number}}}".encode().ljust(length, b".") + b"\r\n"


def test_replies_and_streams_keep_their_common_order() -> None:
    """Lines of both planes leave in the order in which they were put (protocol reference 1.8)."""
    outbox = Outbox()
    outbox.put_stream(b"STA 1\r\n")
    outbox.put_reply(b"CONF 2\r\n")
    outbox.put_stream(b"SEN 3\r\n")
    outbox.put_reply(b"GEO 4\r\n")
    assert drain(outbox) == [b"STA 1\r\n", b"CONF 2\r\n", b"SEN 3\r\n", b"GEO 4\r\n"]


def test_a_report_wakes_its_taker_once_and_may_leave_in_one_piece() -> None:
    """Clients of lockstep get what waits together, up to 16 KiB; all others line by line."""
    wakes: list[int] = []
    outbox = Outbox(lambda: wakes.append(len(outbox)))
    outbox.put_report([b"STA 1\r\n", b"", b"SEN 2\r\n"], b"NFO 3\r\n")
    assert wakes == []
    outbox.rouse()
    outbox.rouse()
    assert wakes == [3]
    assert drain(outbox) == [b"STA 1\r\n", b"SEN 2\r\n", b"NFO 3\r\n"]
    outbox.together = True
    outbox.put_report([b"STA 1\r\n"], b"NFO 3\r\n")
    outbox.rouse()
    outbox.put_reply(b"CONF 4\r\n")
    assert drain(outbox) == [b"STA 1\r\nNFO 3\r\nCONF 4\r\n"]
    outbox.put_report([], b"NFO 5\r\n")
    outbox.rouse()
    assert drain(outbox) == [b"NFO 5\r\n"]
    assert wakes == [3, 2, 1]
    for _ in range(3):
        outbox.put_reply(b"x" * (TOGETHER - 2) + b"\r\n")
    assert [len(one) for one in drain(outbox)] == [TOGETHER] * 3
    outbox.close()
    outbox.put_report([b"STA\r\n"], b"NFO\r\n")
    outbox.rouse()
    assert drain(outbox) == []
    assert len(wakes) == 4


def test_full_stream_budget_drops_the_oldest_streamed_lines_whole() -> None:
    """Protocol 17: a full queue loses whole periodic lines, the oldest ones."""
    outbox = Outbox(limits=OutboxLimits(stream_bytes=30))
    for number in range(5):
        outbox.put_stream(numbered("SEN", number))  # 14 bytes each
    assert drain(outbox) == [numbered("SEN", 3), numbered("SEN", 4)]
    assert outbox.dropped == 3


def test_full_stream_budget_drops_no_reply() -> None:
    """Protocol 18: replies stay however many periodic lines give way around them."""
    outbox = Outbox(limits=OutboxLimits(stream_bytes=30))
    outbox.put_reply(b"CONF\r\n")
    for number in range(100):
        outbox.put_stream(numbered("SEN", 10 + number % 10))
        if number == 50:
            outbox.put_reply(b"GEO\r\n")
    lines = drain(outbox)
    assert [line for line in lines if not line.startswith(b"SEN")] == [b"CONF\r\n", b"GEO\r\n"]
    assert outbox.condemned is None


def test_number_of_streamed_lines_is_bounded_too() -> None:
    """Many tiny lines cannot use more memory than the line limit allows."""
    outbox = Outbox(limits=OutboxLimits(stream_bytes=10**9, stream_lines=10))
    for _ in range(1000):
        outbox.put_stream(b"x\r\n")
    assert len(outbox) == 10
    assert outbox.dropped == 990


def test_line_above_the_whole_budget_is_dropped_alone_and_counted() -> None:
    """A streamed line that could never fit is dropped; the next ordinary one is queued."""
    outbox = Outbox(limits=OutboxLimits(stream_bytes=30))
    outbox.put_stream(b"x" * 31)
    outbox.put_stream(b"SEN\r\n")
    assert drain(outbox) == [b"SEN\r\n"]
    assert outbox.dropped == 1


@pytest.mark.parametrize(
    "limits",
    [OutboxLimits(reply_bytes=100), OutboxLimits(reply_lines=5)],
    ids=["bytes", "lines"],
)
def test_replies_that_nobody_reads_condemn_the_connection(limits: OutboxLimits) -> None:
    """Replies are never dropped: past their limit the outbox is condemned, with a reason."""
    outbox = Outbox(limits=limits)
    for number in range(5):
        outbox.put_reply(numbered("CONF", number))
        assert outbox.condemned is None
    for number in range(5, 10):
        outbox.put_reply(numbered("CONF", number))
    assert outbox.condemned is not None
    assert "replies" in outbox.condemned
    assert outbox.closed


def test_condemned_outbox_keeps_no_memory_and_takes_nothing_more() -> None:
    """After condemnation what waited is gone and later lines are ignored."""
    outbox = Outbox(limits=SMALL)
    outbox.put_stream(b"STA\r\n")
    outbox.condemn("the session failed")
    outbox.put_reply(b"CONF\r\n")
    outbox.put_stream(b"STA\r\n")
    assert (len(outbox), outbox.waiting_bytes, outbox.take()) == (0, 0, None)
    assert outbox.condemned == "the session failed"


def test_first_reason_of_condemnation_stays() -> None:
    """The log shows the cause and not what came after it."""
    outbox = Outbox()
    outbox.condemn("first")
    outbox.condemn("second")
    assert outbox.condemned == "first"


def test_close_is_not_a_condemnation() -> None:
    """A closed outbox ignores lines and gives no reason; closing twice is harmless."""
    outbox = Outbox()
    outbox.put_reply(b"CONF\r\n")
    outbox.close()
    outbox.close()
    outbox.put_reply(b"CONF\r\n")
    outbox.condemn("too late")
    assert outbox.take() is None
    assert outbox.closed
    assert outbox.condemned is None


def test_empty_text_is_nothing_to_send() -> None:
    """Protocol 7: an empty message is not written and wakes nobody."""
    woken: list[int] = []
    outbox = Outbox(lambda: woken.append(1))
    outbox.put_reply(b"")
    outbox.put_stream(b"")
    assert (len(outbox), woken) == (0, [])


def test_taker_is_woken_once_per_burst() -> None:
    """The wake callback runs for the first line after `take` returned None, not for the rest."""
    woken: list[int] = []
    outbox = Outbox(lambda: woken.append(1))
    for _ in range(10):
        outbox.put_stream(b"STA\r\n")
        outbox.put_reply(b"CONF\r\n")
    assert len(woken) == 1
    outbox.take()
    outbox.put_reply(b"CONF\r\n")
    assert len(woken) == 1, "the taker has not seen the end yet"
    drain(outbox)
    outbox.put_reply(b"CONF\r\n")
    assert len(woken) == 2


def test_condemnation_wakes_a_taker_that_is_busy_sending() -> None:
    """Condemning wakes even in the middle of a burst, because the taker may be stuck in a send."""
    woken: list[int] = []
    outbox = Outbox(lambda: woken.append(1), SMALL)
    outbox.put_reply(b"CONF\r\n")
    outbox.condemn("now")
    assert len(woken) == 2


def test_line_that_is_dropped_at_once_wakes_nobody() -> None:
    """A wake always finds a line."""
    woken: list[int] = []
    outbox = Outbox(lambda: woken.append(1), OutboxLimits(stream_bytes=4))
    outbox.put_stream(b"too long\r\n")
    assert woken == []


def test_wake_may_use_the_outbox() -> None:
    """The callback runs without the lock, so that a taker may take within it."""
    taken: list[bytes | None] = []
    outbox = Outbox(lambda: taken.append(outbox.take()))
    outbox.put_reply(b"CONF\r\n")
    assert taken == [b"CONF\r\n"]


class Model:
    """The outbox said simply: one list, searched from the front for something to drop."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, bytes]] = []
        self.dropped = 0

    def put(self, plane: str, line: bytes) -> None:
        """Append, then drop oldest streamed lines until the budget holds."""
        self.lines.append((plane, line))
        while self.stream_bytes > STREAM_BYTES or self.stream_lines > STREAM_LINES:
            self.lines.remove(next(entry for entry in self.lines if entry[0] == "stream"))
            self.dropped += 1

    @property
    def stream_bytes(self) -> int:
        """Bytes of streamed lines."""
        return sum(len(line) for plane, line in self.lines if plane == "stream")

    @property
    def stream_lines(self) -> int:
        """Number of streamed lines."""
        return sum(plane == "stream" for plane, _ in self.lines)

    def take(self) -> bytes | None:
        """The oldest line."""
        return self.lines.pop(0)[1] if self.lines else None


OPERATIONS = st.lists(
    st.tuples(st.sampled_from(["reply", "stream", "take"]), st.integers(0, 120)), max_size=80
)


@given(OPERATIONS)
@settings(max_examples=300, deadline=None)
def test_outbox_behaves_like_the_simple_model(operations: list[tuple[str, int]]) -> None:
    """Whatever is put and taken: same lines, same order, same number dropped, budgets kept."""
    outbox, model = Outbox(limits=ENDLESS_REPLIES), Model()
    for number, (operation, length) in enumerate(operations):
        line = numbered(operation, number, length)
        if operation == "take":
            assert outbox.take() == model.take()
        elif operation == "reply":
            outbox.put_reply(line)
            model.put("reply", line)
        else:
            outbox.put_stream(line)
            model.put("stream", line)
        assert len(outbox) == len(model.lines)
        assert outbox.dropped == model.dropped
        assert outbox.waiting_bytes == sum(len(line) for _, line in model.lines)
    assert drain(outbox) == [line for _, line in model.lines]


@given(OPERATIONS)
@settings(max_examples=200, deadline=None)
def test_memory_stays_within_the_limits(operations: list[tuple[str, int]]) -> None:
    """Waiting bytes and lines never exceed both limits together; beyond, the outbox is shut."""
    outbox = Outbox(limits=SMALL)
    for number, (operation, length) in enumerate(operations):
        put = outbox.put_reply if operation == "reply" else outbox.put_stream
        put(numbered("SEN", number, length))
        assert outbox.waiting_bytes <= SMALL.stream_bytes + SMALL.reply_bytes
        assert len(outbox) <= SMALL.stream_lines + SMALL.reply_lines
        assert outbox.closed == (outbox.condemned is not None)


@given(st.lists(st.sampled_from(["put", "take"]), max_size=60))
@settings(deadline=None)
def test_no_wake_is_lost_and_none_is_doubled(operations: list[str]) -> None:
    """A taker that sleeps after None is woken exactly when a line arrives, and only once."""
    wakes = 0

    def wake() -> None:
        nonlocal wakes
        wakes += 1

    outbox = Outbox(wake)
    asleep = True
    for operation in operations:
        before = wakes
        if operation == "put":
            outbox.put_stream(b"STA\r\n")
            assert wakes - before == int(asleep)
            asleep = False
        elif outbox.take() is None:
            asleep = True
        else:
            assert wakes == before


def test_threads_lose_no_reply_and_keep_each_ones_order() -> None:
    """Four robots' threads and one taker: every reply arrives once, in its thread's order."""
    ready = threading.Event()
    per_thread = 2000
    outbox = Outbox(ready.set, OutboxLimits(reply_lines=4 * per_thread))  # however late the taker
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)

    def produce(head: str) -> None:
        for number in range(per_thread):
            outbox.put_reply(numbered(head, number))
            outbox.put_stream(b"STA\r\n")

    threads = [threading.Thread(target=produce, args=(head,)) for head in "ABCD"]
    received: list[bytes] = []
    try:
        for thread in threads:
            thread.start()
        while len(received) < 4 * per_thread:
            assert ready.wait(PATIENCE), "a wake was lost"
            ready.clear()
            received += [line for line in drain(outbox) if line != b"STA\r\n"]
    finally:
        sys.setswitchinterval(interval)
        for thread in threads:
            thread.join()
    for head in "ABCD":
        mine = [line for line in received if line.startswith(head.encode())]
        assert mine == [numbered(head, number) for number in range(per_thread)]


# -- a client that reads, but slowly ---------------------------------------------------------------


class Clock:
    """Wall time that stands still until it is moved."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def half_full(clock: Clock, grace: Grace | None = None) -> Outbox:
    """An outbox whose streams fill half of a budget of 1 MiB."""
    limits = OutboxLimits(stream_bytes=1 << 20, stream_lines=1 << 20)
    outbox = Outbox(limits=limits, clock=clock, grace=grace)
    while outbox.waiting_bytes < 1 << 19:
        outbox.put_stream(b"x" * 1022 + b"\r\n")
    return outbox


def test_an_empty_outbox_is_not_crowded() -> None:
    """Nor is one that is filled to less than a half."""
    outbox = Outbox(limits=OutboxLimits(stream_bytes=100, stream_lines=4))
    assert not outbox.crowded
    outbox.put_stream(b"x" * 49)
    assert not outbox.crowded
    outbox.put_stream(b"x")
    assert outbox.crowded, "by bytes"
    outbox = Outbox(limits=OutboxLimits(stream_bytes=100, stream_lines=4))
    outbox.put_stream(b"x")
    outbox.put_stream(b"x")
    assert outbox.crowded, "by lines"


def test_who_reads_is_waited_for_as_long_as_it_takes() -> None:
    """At a little more than the least rate, for a minute in which the server fills up again."""
    clock = Clock()
    outbox = half_full(clock)
    for _ in range(60 * 10):
        assert outbox.crowded
        clock.now += 0.1
        for _ in range(LEAST_READ // 10 // 1024 + 1):
            outbox.take()
            outbox.put_stream(b"x" * 1022 + b"\r\n")


def waited(outbox: Outbox, clock: Clock, seconds: float) -> float:
    """Let a world ask every 10 ms for so long: the wall time that it waited."""
    total = 0.0
    for _ in range(round(seconds / 0.01)):
        total += 0.01 * outbox.crowded
        clock.now += 0.01
    return total


def test_clients_that_do_not_read_have_one_grace_together() -> None:
    """The world waits a second for the first, and then a fiftieth of the time however many there
    are and however often they come, so that they lose lines. A client that reads is waited for as
    before."""
    clock = Clock()
    grace = Grace(TokenBucket(GRACE_SHARE, GRACE, clock=clock))
    assert waited(half_full(clock, grace), clock, 3.0) == pytest.approx(GRACE, abs=0.1)
    more = sum(waited(half_full(clock, grace), clock, 1.0) for _ in range(100))
    assert more == pytest.approx(100 * GRACE_SHARE, abs=1.0)
    reader = half_full(clock, grace)
    assert waited(reader, clock, 1.0) < 0.1
    for _ in range(2 * LEAST_READ // 1024):
        reader.take()
        reader.put_stream(b"x" * 1022 + b"\r\n")
    assert waited(reader, clock, 3.0) == pytest.approx(2.0, abs=0.1), "it has read so much"


def test_who_dawdles_is_waited_for_again_after_it_has_read() -> None:
    """A client that was given up gets its grace again once a quarter is left."""
    clock = Clock()
    outbox = half_full(clock)
    assert waited(outbox, clock, 10.0) < 2 * GRACE
    assert not outbox.crowded
    while outbox.waiting_bytes >= 1 << 18:
        outbox.take()
    assert not outbox.crowded
    while outbox.waiting_bytes < 1 << 19:
        outbox.put_stream(b"x" * 1022 + b"\r\n")
    assert outbox.crowded
