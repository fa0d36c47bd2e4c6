"""The control service over real sockets: what a client sends arrives, what it is sent is whole."""

from __future__ import annotations

import asyncio
import random
import selectors
import socket
import time

import pytest
from services_harness import GREETING, eventually, fill, words

from usarsim_server.services import listener
from usarsim_server.services.control import ControlLimits
from usarsim_server.sessions.outbox import OutboxLimits

SLOW = OutboxLimits(stream_bytes=64 * 1024)


# Greeting and silence


def test_greeting_is_the_first_and_only_line(control):
    """Protocol 2 and 5: one NFO line on accept, before any input, then silence."""
    server = control()
    client = server.connect(greet=False)
    assert client.line() == GREETING
    assert client.silent_for(0.3)


def test_agent_knows_its_client_by_the_peer_address(control):
    """The name of the connection is the client's own `host:port`."""
    server = control()
    client, session = server.pair()
    assert session.peer == client.peer


def test_greeting_comes_before_lines_of_a_hasty_session(control):
    """Even a line that waits before the first read comes after the greeting."""
    server = control()
    client = server.connect(greet=False)
    client.send(b"GETCONF {Name early}\r\n")
    assert client.line() == GREETING
    assert client.line() == b"CONF {Name early}\r\n"


# Input


def test_command_in_one_byte_packets_is_executed(control):
    """Protocol 26 and 27: one byte per packet, executed when the terminator comes."""
    client, session = control().pair()
    for byte in b"DRIVE {Left 1.0}":
        client.send(bytes([byte]))
        time.sleep(0.001)
    time.sleep(0.05)
    assert session.commands == []
    client.send(b"\n")
    assert eventually(lambda: words(session) == ["DRIVE"])
    assert session.commands[0].get("Left") == "1.0"


@pytest.mark.parametrize("end", [b"\r\n", b"\n", b"\r", b"\n\r", b"\r\n\n"])
def test_every_line_end_counts_once(control, end):
    """Protocol 21 to 24: CR LF, LF, CR and LF CR each end a command, at once and only once."""
    client, session = control().pair()
    client.send(b"GETCONF {Name a}" + end)
    assert client.line() == b"CONF {Name a}\r\n"
    client.send(b"GETCONF {Name b}" + end)
    assert client.line() == b"CONF {Name b}\r\n"
    assert words(session) == ["GETCONF", "GETCONF"]


def test_commands_of_one_packet_are_handed_over_in_order(control):
    """Protocol 25 and 30: several commands in one packet, replies in the order of requests."""
    client, session = control().pair()
    client.send(b"INIT {ClassName USARBot.P2AT}\r\nGETCONF {Name 1}\r\nGETCONF {Name 2}\r\n")
    assert [client.line(), client.line()] == [b"CONF {Name 1}\r\n", b"CONF {Name 2}\r\n"]
    assert words(session) == ["INIT", "GETCONF", "GETCONF"]


def test_glued_commands_are_both_executed(control):
    """Protocol 29: a command without terminator does not swallow the one glued to it."""
    client, session = control().pair()
    client.send(
        b"SET {Type RFIDReleaser} {Name Gun} {Opcode Release}DRIVE {Left 1.0} {Right 1.0}\r\n"
    )
    assert eventually(lambda: words(session) == ["SET", "DRIVE"])


def test_order_survives_any_cutting_into_packets(control):
    """A thousand commands cut at random places arrive complete and in order."""
    client, session = control().pair()
    generator = random.Random(7)
    data = b"".join(f"DRIVE {{Left {number}}}\r\n".encode() for number in range(1000))
    while data:
        size = generator.randint(1, 300)
        client.send(data[:size])
        data = data[size:]
    assert eventually(lambda: len(session.commands) == 1000)
    assert [command.get("Left") for command in session.commands] == [str(n) for n in range(1000)]


def test_random_bytes_do_not_end_the_connection(control):
    """Protocol 19: after 1000 lines of random bytes a valid command still works."""
    client, _ = control().pair()
    generator = random.Random(19)
    for _ in range(1000):
        client.send(generator.randbytes(generator.randint(0, 80)).replace(b"GETCONF", b"") + b"\n")
    client.send(b"GETCONF {Name alive}\r\n")
    assert client.line() == b"CONF {Name alive}\r\n"


def test_long_lines_are_processed_and_endless_ones_discarded(control, caplog):
    """Protocol 20: 65536 bytes are a command, a MiB without terminator is thrown away."""
    caplog.set_level("INFO", "usarsim")
    client, session = control().pair()
    command = b"GETCONF {Name long}"
    client.send(command.ljust(65536) + b"\r\n")
    assert client.line() == b"CONF {Name long}\r\n"
    client.send(b"x" * 2**20 + b"\r\nGETCONF {Name next}\r\n")
    assert client.line() == b"CONF {Name next}\r\n"
    assert words(session) == ["GETCONF", "GETCONF"]
    assert caplog.messages.count("line discarded: too long") == 1


def test_the_loop_is_told_once_to_read_many_chunks(control, monkeypatch):
    """A client that sends one command after the other costs no system call but the reading."""
    told = []
    register = selectors.DefaultSelector.register

    def noted(self, client, *arguments):
        told.append(client)
        return register(self, client, *arguments)

    monkeypatch.setattr(selectors.DefaultSelector, "register", noted)
    server = control()
    client, session = server.pair()
    for number in range(50):
        client.send(b"DRIVE {Left %d}\r\n" % number)
        assert eventually(lambda number=number: len(session.commands) > number)
        for _ in range(5):  # a client that is quicker than the server finds nobody who waits
            server.call(asyncio.sleep(0.0))
    assert len(told) < 15
    assert [one.get("Left") for one in session.commands] == [str(n) for n in range(50)]


def test_agent_is_called_on_the_event_loop(control):
    """All commands are submitted by one thread, so sessions need no order of their own."""
    server = control()
    client, session = server.pair()
    client.send(b"DRIVE {Left 1}\r\n")
    assert eventually(lambda: session.submit_thread == server.thread.ident)


# Output


def test_every_line_is_one_send_call(control, monkeypatch):
    """Protocol 10: a trace of the send calls shows one call per line, never two lines or half."""
    calls = []
    send = socket.socket.send

    def traced(self, data, *flags):
        calls.append(bytes(data))
        return send(self, data, *flags)

    monkeypatch.setattr(socket.socket, "send", traced)
    server = control()
    client, session = server.pair()
    mine = [GREETING]
    for number in range(200):
        line = f"SEN {{Time {number}}}\r\n".encode()
        mine.append(line)
        (session.outbox.put_stream if number % 3 else session.outbox.put_reply)(line)
    received = [GREETING] + [client.line() for _ in range(200)]
    assert received == mine
    assert [call for call in calls if call != b"\0"] == mine  # b"\0" wakes the event loop


def test_no_send_call_holds_parts_of_two_lines_when_the_client_is_slow(control, monkeypatch):
    """Protocol 10 and 17: a line is continued in full buffers, never joined to another."""
    calls = []
    send = socket.socket.send

    def traced(self, data, *flags):
        calls.append(bytes(data))
        return send(self, data, *flags)

    monkeypatch.setattr(socket.socket, "send", traced)
    server = control(ControlLimits(outbox=SLOW, receive_buffer=4096, send_buffer=4096))
    client, session = server.pair(receive_buffer=4096)
    fill(session, 400)
    time.sleep(0.1)
    session.outbox.put_reply(b"CONF {Name end}\r\n")
    while client.line() != b"CONF {Name end}\r\n":
        pass
    assert len(calls) > 100
    assert all(call.count(b"\r\n") <= 1 and b"\r\n" not in call[:-2] for call in calls)


def test_accepted_sockets_send_at_once_and_have_small_buffers(control, monkeypatch):
    """Protocol 11: TCP_NODELAY is set; dead machines are noticed; kernel buffers are bounded."""
    accepted = []
    tune = listener.tune

    def spy(client):
        tune(client)
        accepted.append(client)

    monkeypatch.setattr(listener, "tune", spy)
    server = control(ControlLimits(receive_buffer=16 * 1024, send_buffer=16 * 1024))
    server.connect()
    [client] = accepted
    assert client.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1
    assert client.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
    # Linux doubles what is asked for, to allow for its own bookkeeping.
    assert client.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) <= 2 * 16 * 1024
    assert client.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) <= 2 * 16 * 1024


def test_slow_reader_loses_whole_streamed_lines_and_no_reply(control, caplog):
    """Protocol 17 and 18: after a pause every line is whole and in order, replies complete."""
    caplog.set_level("INFO", "usarsim")
    server = control(ControlLimits(outbox=SLOW, receive_buffer=8192, send_buffer=8192))
    client, session = server.pair(receive_buffer=8192)
    lines = fill(session, 1000)
    for number in range(20):
        client.send(f"GETCONF {{Name {number}}}\r\n".encode())
    assert eventually(lambda: len(session.commands) == 20)
    lines += fill(session, 1000)  # and the stream goes on while nobody reads
    session.outbox.put_reply(b"GEO {Name last}\r\n")
    assert session.outbox.dropped > 500
    received = []
    while not received or received[-1] != b"GEO {Name last}\r\n":
        received.append(client.line())
    streamed = [line for line in received if line.startswith(b"SEN")]
    assert set(streamed) <= set(lines), "a line was cut"
    times = [int(line.split(b"{Time ")[1].split(b"}")[0]) for line in streamed]
    second = len(times) - 1 - max(i for i in range(len(times) - 1) if times[i] > times[i + 1])
    assert second > 0
    replies = [line for line in received if line.startswith(b"CONF")]
    assert replies == [f"CONF {{Name {number}}}\r\n".encode() for number in range(20)]
    assert len(received) == 21 + len(streamed)
    assert len(streamed) + session.outbox.dropped == 2000
    assert eventually(lambda: any("too slow" in message for message in caplog.messages))


def test_first_line_after_a_pause_is_recent(control):
    """A client that resumes skips what is out of date: it lags by the buffers, not by its pause."""
    server = control(ControlLimits(outbox=SLOW, receive_buffer=8192, send_buffer=8192))
    client, session = server.pair(receive_buffer=8192)
    lines = fill(session, 3000)
    session.outbox.put_reply(b"GEO {Name last}\r\n")
    received = []
    while not received or received[-1] != b"GEO {Name last}\r\n":
        received.append(client.line())
    newest = lines[-100:]
    assert received[-101:-1] == newest
    assert sum(map(len, received)) < SLOW.stream_bytes + 8 * 8192


def test_client_that_asks_without_reading_is_cut_off(control, caplog):
    """Replies are never dropped: a client that lets them pile up is closed, with a log line."""
    limits = ControlLimits(
        outbox=OutboxLimits(reply_bytes=64 * 1024), receive_buffer=8192, send_buffer=8192
    )
    server = control(limits)
    greedy, session = server.pair(receive_buffer=8192)
    for number in range(2000):
        session.outbox.put_reply(f"CONF {{Name {number}}} {'x' * 100}\r\n".encode())
    assert eventually(lambda: session.closes == 1)
    assert greedy.ended()
    [record] = [r for r in caplog.records if r.message == "connection closed by the server"]
    assert record.usarsim_facts["connection"] == session.peer
    assert "replies" in record.usarsim_facts["reason"]
    polite, _ = server.pair()
    polite.send(b"GETCONF {Name polite}\r\n")
    assert polite.line() == b"CONF {Name polite}\r\n"


def test_agent_can_end_its_connection(control):
    """A session that cannot go on condemns its outbox; the client sees the end at once."""
    client, session = control().pair()
    session.outbox.condemn("the robot thread failed")
    assert client.ended()
    assert eventually(lambda: session.closes == 1)


def test_64_clients_that_never_read_delay_nobody_and_stay_bounded(control):
    """Protocol 12 and 16: 64 silent clients cost their budget each, another is served."""
    outbox = OutboxLimits(stream_bytes=8192)
    server = control(
        ControlLimits(max_connections=65, outbox=outbox, receive_buffer=4096, send_buffer=4096)
    )
    silent = [server.pair(receive_buffer=4096) for _ in range(64)]
    for _, session in silent:
        fill(session, 200)
    client, _ = server.pair()
    for number in range(50):
        client.send(f"GETCONF {{Name {number}}}\r\n".encode())
        assert client.line() == f"CONF {{Name {number}}}\r\n".encode()
        for _, session in silent:
            session.outbox.put_stream(b"STA {Time 1.00}\r\n")
    assert all(session.outbox.dropped for _, session in silent), "the buffers were not full"
    assert all(session.outbox.waiting_bytes <= outbox.stream_bytes for _, session in silent)
    assert all(session.closes == 0 for _, session in silent)
