"""How connections of the control service end, are pushed back, share the loop and fail."""

from __future__ import annotations

import asyncio
import os
import socket
import time
from collections import Counter

import pytest
from services_harness import GREETING, FakeAgent, eventually, fill, words

from usarsim_server.services import control as control_module
from usarsim_server.services import listener as listener_module
from usarsim_server.services.control import ControlLimits, ControlService
from usarsim_server.sessions.outbox import OutboxLimits
from usarsim_server.testing import PATIENCE

SLOW = OutboxLimits(stream_bytes=64 * 1024)


# Ends


def end_by_close(client):
    """An orderly close in the middle of a line."""
    client.send(b"DRIVE {Left 1.0} {Ri")
    client.close()


def end_by_reset(client):
    """A TCP reset."""
    client.reset()


def end_by_half_close(client):
    """The sending side alone is closed."""
    client.socket.shutdown(socket.SHUT_WR)


@pytest.mark.parametrize("end", [end_by_close, end_by_reset, end_by_half_close])
def test_every_kind_of_close_ends_the_agent_promptly_and_once(control, end):
    """Protocol 13 and 14: close, reset and half-close end the session."""
    server = control()
    client, session = server.pair()
    end(client)
    assert eventually(lambda: session.closes == 1)
    assert eventually(lambda: server.service.connections == 0)
    time.sleep(0.02)
    assert session.closes == 1
    assert session.commands == [], "a line without terminator is no command (protocol 27)"
    assert session.outbox.closed


@pytest.mark.parametrize("end", [end_by_close, end_by_reset])
def test_close_ends_the_agent_while_output_is_stuck(control, end):
    """A client that never read and closes is noticed although the writer waits for it."""
    server = control(ControlLimits(outbox=SLOW, receive_buffer=4096, send_buffer=4096))
    client, session = server.pair(receive_buffer=4096)
    fill(session, 500)
    end(client)
    assert eventually(lambda: session.closes == 1)


def test_half_closed_client_sees_the_end(control):
    """Protocol 14: the server answers a half-close by closing too."""
    client, _ = control().pair()
    client.socket.shutdown(socket.SHUT_WR)
    assert client.line() == b""


def test_commands_before_the_close_are_still_handed_over(control):
    """What was complete when the client closed reaches the session before its close."""
    client, session = control().pair()
    client.send(b"DRIVE {Left 1}\r\nDRIVE {Left 2}\r\n")
    client.close()
    assert eventually(lambda: session.closes == 1)
    assert words(session) == ["DRIVE", "DRIVE"]


def test_client_can_come_back(control):
    """Protocol 15: after a close the same client connects anew and gets a new session."""
    server = control()
    for _ in range(3):
        client, session = server.pair()
        client.send(b"GETCONF {Name again}\r\n")
        assert client.line() == b"CONF {Name again}\r\n"
        client.close()
        assert eventually(lambda session=session: session.closes == 1)
    assert len(server.sessions) == 3


def test_connection_beyond_the_limit_is_closed_at_once(control, caplog):
    """Protocol 12: 64 are served, the 65th reads nothing but the end; a free place is given on."""
    server = control()
    clients = [server.connect() for _ in range(64)]
    surplus = server.connect(greet=False)
    assert surplus.line() == b""
    assert len(server.sessions) == 64
    assert "connection refused: too many clients" in caplog.messages
    clients[0].close()
    assert eventually(lambda: server.service.connections == 63)
    late = server.connect()
    late.send(b"GETCONF {Name late}\r\n")
    assert late.line() == b"CONF {Name late}\r\n"


def test_stop_closes_connections_agents_and_port(control, caplog, monkeypatch):
    """After stop every client sees the end, every session is closed and the port is free."""
    monkeypatch.setattr(listener_module, "_STOP_TIMEOUT", PATIENCE)
    server = control(ControlLimits(outbox=SLOW, receive_buffer=4096, send_buffer=4096))
    pairs = [server.pair(receive_buffer=4096) for _ in range(5)]
    fill(pairs[0][1], 500)  # one that is stuck in a send
    server.stop_service()
    assert "connections did not end in time" not in caplog.messages
    assert [session.closes for _, session in pairs] == [1] * 5
    assert all(client.ended() for client, _ in pairs)
    with socket.create_server(("127.0.0.1", server.endpoint.port)):
        pass


def test_agents_may_speak_after_the_end_of_the_loop(control):
    """A robot thread that is slower than the end of the process does no harm."""
    server = control()
    _, session = server.pair()
    server.stop()
    session.outbox.put_reply(b"CONF\r\n")
    session.on_backlog_low()
    session.outbox.condemn("too late")


# Back-pressure


FLOOD = b"DRIVE {Left 1.00} {Right 1.00}\r\n"


def flood(client, count):
    """Send until the server's side is full; returns how many whole commands were sent."""
    client.socket.setblocking(False)
    data = FLOOD * count
    sent = 0
    idle_since = time.monotonic()
    while sent < len(data) and time.monotonic() - idle_since < 0.3:
        try:
            sent += client.socket.send(data[sent : sent + 65536])
            idle_since = time.monotonic()
        except BlockingIOError:
            time.sleep(0.01)
    client.socket.settimeout(PATIENCE)
    return sent


def test_flood_is_pushed_back_and_nothing_is_lost(control):
    """While a session lags its client's input is not read; later all of it arrives in order."""
    limits = ControlLimits(backlog_high=100, backlog_low=20, receive_buffer=8192, send_buffer=8192)
    server = control(limits, hold=True)
    client, session = server.pair(send_buffer=8192)
    sent = flood(client, 100_000)
    assert sent < len(FLOOD) * 100_000, "the client was never pushed back"
    per_chunk = 2048 // len(FLOOD) + 1
    assert session.most_waiting <= limits.backlog_high + per_chunk
    rest = -sent % len(FLOOD)
    session.hold = False
    session.release()
    client.send(FLOOD[len(FLOOD) - rest :] if rest else b"")
    client.send(b"GETCONF {Name done}\r\n")
    assert client.line() == b"CONF {Name done}\r\n"
    assert len(session.commands) == (sent + rest) // len(FLOOD) + 1
    assert {command.word for command in session.commands[:-1]} == {"DRIVE"}


def test_reading_goes_on_at_the_low_mark_only(control, monkeypatch):
    """Between the marks nothing is read; at the low one the session's word alone sets it going."""
    monkeypatch.setattr(control_module, "_HANG_UP_POLL", 60.0)
    limits = ControlLimits(backlog_high=50, backlog_low=10, receive_buffer=4096, send_buffer=4096)
    server = control(limits, hold=True)
    client, session = server.pair(send_buffer=4096)
    flood(client, 20_000)
    assert eventually(lambda: session.backlog > 50)
    before = session.backlog
    session.release(before - 11)
    time.sleep(0.05)
    assert session.backlog == 11
    session.release(1)
    assert eventually(lambda: session.backlog > 11)


def test_forgotten_notice_delays_reading_but_does_not_stop_it(control):
    """A session that never says that it caught up is looked at five times a second."""
    limits = ControlLimits(backlog_high=50, backlog_low=10, receive_buffer=4096, send_buffer=4096)
    server = control(limits, hold=True)
    client, session = server.pair(send_buffer=4096)
    flood(client, 20_000)
    assert eventually(lambda: session.backlog > 50)
    session.release(tell=False)
    assert eventually(lambda: session.backlog > 0)


@pytest.mark.parametrize("end", [end_by_reset, lambda client: client.close()])
def test_close_behind_a_flood_is_noticed(control, end):
    """Protocol 13: a client that floods and closes goes at once, though its input is unread."""
    server = control(ControlLimits(backlog_high=50, backlog_low=10), hold=True)
    client, session = server.pair()
    client.send(FLOOD * 1000)  # about half of the receive buffer
    assert eventually(lambda: session.backlog > 50)
    time.sleep(0.05)
    assert session.backlog < 500, "input was not paused"
    end(client)
    assert eventually(lambda: session.closes == 1)


def test_close_behind_more_than_is_read_is_noticed(control, monkeypatch):
    """A client that closes while its kernel still holds input cannot say so: it is challenged."""
    monkeypatch.setattr(control_module, "CHALLENGE", 0.3)
    limits = ControlLimits(backlog_high=50, backlog_low=10, receive_buffer=4096, send_buffer=4096)
    server = control(limits, hold=True)
    client, session = server.pair()
    flood(client, 20_000)
    assert eventually(lambda: session.backlog > 50)
    client.close()
    assert eventually(lambda: session.closes == 1)


def test_a_challenge_is_not_seen_by_a_client_that_lives(control, monkeypatch):
    """It is asked several times while it is not read, stays, and reads whole lines only."""
    asked = []
    monkeypatch.setattr(control_module, "CHALLENGE", 0.0)
    monkeypatch.setattr(control_module, "_HANG_UP_POLL", 0.02)
    challenge = listener_module.challenge
    monkeypatch.setattr(
        control_module, "challenge", lambda client: (challenge(client), asked.append(client))
    )
    limits = ControlLimits(backlog_high=50, backlog_low=10, receive_buffer=4096, send_buffer=4096)
    server = control(limits, hold=True)
    client, session = server.pair()
    flood(client, 20_000)
    assert eventually(lambda: len(asked) > 3)
    session.outbox.put_stream(b"STA {Time 1.00}\r\n")
    session.outbox.put_stream(b"STA {Time 2.00}\r\n")
    assert [client.line(), client.line()] == [b"STA {Time 1.00}\r\n", b"STA {Time 2.00}\r\n"]
    assert session.closes == 0


def test_flooding_client_does_not_delay_another(control):
    """A client that sends as fast as it can leaves others their turn."""
    server = control()
    flooder = server.connect()
    flooder.socket.setblocking(False)
    client = server.connect()
    for number in range(15):
        for _ in range(5):
            try:
                flooder.socket.send(FLOOD * 500)
            except BlockingIOError:
                break
        client.send(f"GETCONF {{Name {number}}}\r\n".encode())
        assert client.line() == f"CONF {{Name {number}}}\r\n".encode()


class Turns:
    """Counts the turns of an event loop."""

    def __init__(self):
        self.now = 0
        self.task = asyncio.create_task(self._count())

    async def _count(self):
        while True:
            await asyncio.sleep(0)
            self.now += 1


def most_in_one_turn(moments):
    """How many things happened in the same turn of the loop, at most."""
    return max(Counter(moments).values())


def test_each_chunk_of_input_is_a_turn_of_the_loop():
    """Input that waits in the kernel is read chunk by chunk, other clients come in between."""
    submitted, seen = [], []

    async def scenario():
        turns = Turns()
        complete = asyncio.Event()

        class Session:
            backlog, work, has_role = 0, 0.0, True

            def submit(self, commands):
                submitted.append(turns.now)
                seen.extend(commands)
                if len(seen) == 1000:
                    complete.set()

            def close(self):
                pass

        service = ControlService("127.0.0.1", 0, GREETING, lambda *_: Session())
        endpoint = await service.start()
        with socket.create_connection((endpoint.host, endpoint.port)) as client:
            client.sendall(FLOOD * 1000)  # the loop does not run meanwhile
            await complete.wait()
        turns.task.cancel()
        await service.stop()

    asyncio.run(asyncio.wait_for(scenario(), PATIENCE))
    assert len(submitted) > 10
    assert most_in_one_turn(submitted) == 1


def test_output_gives_others_their_turn(monkeypatch):
    """A client with many lines waiting gets some per turn of the loop and not all at once."""
    sends = []
    send = socket.socket.send

    async def scenario():
        turns = Turns()
        complete = asyncio.Event()

        def traced(self, data, *flags):
            if data.startswith(b"SEN"):
                sends.append(turns.now)
                if len(sends) == 500:
                    complete.set()
            return send(self, data, *flags)

        monkeypatch.setattr(socket.socket, "send", traced)

        def session(peer, outbox, on_backlog_low):
            fill(FakeAgent(peer, outbox, on_backlog_low, hold=False), 500, length=1)
            return FakeAgent(peer, outbox, on_backlog_low, hold=False)

        service = ControlService("127.0.0.1", 0, GREETING, session)
        endpoint = await service.start()
        with socket.create_connection((endpoint.host, endpoint.port)):
            await complete.wait()
        turns.task.cancel()
        await service.stop()

    asyncio.run(asyncio.wait_for(scenario(), PATIENCE))
    assert most_in_one_turn(sends) <= 32


# Defects of sessions


def test_defect_in_an_agent_ends_its_connection_only(control, caplog):
    """An exception out of `submit` closes that connection, with a traceback, and no other."""
    server = control()
    other, _ = server.pair()
    client, session = server.pair()
    client.send(b"KILL\r\n")
    assert client.ended()
    assert eventually(lambda: session.closes == 1)
    assert eventually(lambda: any(record.exc_info for record in caplog.records))
    other.send(b"GETCONF {Name other}\r\n")
    assert other.line() == b"CONF {Name other}\r\n"


def test_defect_in_the_factory_ends_its_connection_only(control, caplog):
    """A client whose session cannot be made is closed; the next one is served."""
    server = control()
    server.refuse = RuntimeError("no session today")
    assert server.connect(greet=False).ended()
    server.refuse = None
    client, _ = server.pair()
    client.send(b"GETCONF {Name next}\r\n")
    assert client.line() == b"CONF {Name next}\r\n"
    assert any("no session today" in str(record.exc_info) for record in caplog.records)


def test_connections_leave_no_descriptors_behind(control):
    """A hundred short connections, refused and served, leave as many open files as before."""
    server = control(ControlLimits(max_connections=2))
    keep = server.connect()
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(50):
        client = server.connect()
        surplus = server.connect(greet=False)
        assert surplus.ended()
        surplus.close()
        client.close()
        assert eventually(lambda: server.service.connections == 1)
    server.clients[:] = [keep]
    assert eventually(lambda: len(os.listdir("/proc/self/fd")) <= before)
