"""Limits that keep clients from each other: one test for each, in figures and over sockets."""

from __future__ import annotations

import math
import socket
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from services_harness import GREETING, Client, Running, eventually, words

from usarsim_server.base.errors import SpawnError
from usarsim_server.base.token_bucket import TokenBucket
from usarsim_server.services import limits as module
from usarsim_server.services import listener as listener_module
from usarsim_server.services.control import ControlLimits
from usarsim_server.services.limits import (
    AddressBuckets,
    InputRates,
    SpawnGate,
    input_cost,
    work_cost,
)
from usarsim_server.testing import PATIENCE


class Watch:
    """A clock that goes when told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def visitor(server: Running, address: str = "127.0.0.2") -> Client:
    """A client with another address of this machine; it has not read its greeting."""
    client = Client.__new__(Client)
    client.socket = socket.create_connection(
        (server.endpoint.host, server.endpoint.port), PATIENCE, (address, 0)
    )
    client._rest = b""
    server.clients.append(client)
    return client


# Buckets


def test_bucket_gives_its_burst_at_once_and_then_its_rate() -> None:
    """Ten at once, then two a second, and never more than ten saved up."""
    clock = Watch()
    bucket = TokenBucket(2.0, 10.0, clock=clock)
    assert [bucket.take() for _ in range(11)] == [True] * 10 + [False]
    clock.now += 1.0
    assert [bucket.take() for _ in range(3)] == [True, True, False]
    clock.now += 1e6
    assert sum(bucket.take() for _ in range(20)) == 10


def test_bucket_on_credit_tells_how_long_to_wait() -> None:
    """What is taken beyond the tokens is paid back at the rate; a debt has its floor."""
    clock = Watch()
    bucket = TokenBucket(10.0, 5.0, deepest=20.0, clock=clock)
    assert bucket.spend(5.0) == 0.0
    assert bucket.spend(5.0) == pytest.approx(0.5)
    clock.now += 0.2
    assert bucket.spend(0.0) == pytest.approx(0.3)
    assert bucket.spend(1e9) == pytest.approx(2.0)
    clock.now += 2.0
    assert bucket.spend(0.0) == pytest.approx(0.0)


def test_bucket_without_a_rate_limit_is_never_empty() -> None:
    """An infinite rate lets everything pass, on credit or not."""
    bucket = TokenBucket(math.inf, 1.0, clock=Watch())
    assert all(bucket.take() for _ in range(100))
    assert bucket.spend(1e12) == 0.0
    assert bucket.take()


def test_bucket_can_be_drawn_from_and_filled_up() -> None:
    """`draw` takes what there is, `give` puts back no more than fits."""
    bucket = TokenBucket(1.0, 10.0, clock=Watch())
    assert (bucket.draw(4.0), bucket.draw(100.0), bucket.draw(1.0)) == (4.0, 6.0, 0.0)
    bucket.give(50.0)
    assert bucket.tokens == 10.0


@settings(max_examples=50)
@given(
    st.lists(st.tuples(st.floats(0.0, 10.0), st.floats(0.0, 50.0)), max_size=30),
    st.floats(0.1, 100.0),
    st.floats(1.0, 100.0),
)
def test_nobody_gets_more_than_burst_and_rate(
    steps: list[tuple[float, float]], rate: float, burst: float
) -> None:
    """Whatever is asked for and when: who waits as told gets at most burst + rate * time."""
    clock = Watch()
    bucket = TokenBucket(rate, burst, clock=clock)
    start, got = clock.now, 0.0
    for pause, amount in steps:
        clock.now += pause + bucket.spend(amount)
        clock.now += bucket.spend(0.0)
        got += amount
        assert got <= burst + rate * (clock.now - start) + 1e-6 * (1.0 + got)


def test_addresses_are_forgotten_before_they_fill_the_memory() -> None:
    """Of many addresses those with full buckets go first; at last all of them start anew."""
    clock = Watch()
    buckets = AddressBuckets(lambda: TokenBucket(1.0, 2.0, clock=clock))
    buckets["busy"].spend(2.0)
    for number in range(3000):
        buckets[f"10.0.{number // 256}.{number % 256}"].spend(0.0)
        assert len(buckets) <= module._MOST_ADDRESSES
    assert buckets["busy"].tokens == 0.0
    for number in range(3000):
        buckets[f"10.1.{number // 256}.{number % 256}"].spend(1.0)
        assert len(buckets) <= module._MOST_ADDRESSES


# What input costs


def test_commands_of_known_clients_cost_one_each() -> None:
    """A flood of DRIVE is counted in commands, whatever the commands say."""
    line = b"DRIVE {Left -100.000000} {Right -100.000000} {Normalized True} {Light False}"
    assert input_cost([line] * 10, 10) == pytest.approx(10.0, abs=0.3)


def test_work_that_hides_in_few_lines_is_paid_for() -> None:
    """Long lines, commands glued together, lines that say nothing and bytes of no line at all."""
    assert input_cost([b"X" * 65536], 1) > 256
    assert input_cost([b"{}ACT" * 100], 100) > 100
    assert input_cost([b" "] * 100, 0) > 100
    assert input_cost([], 0) > 0.0


# Rates of commands


def test_real_controllers_are_never_held_back() -> None:
    """180 commands a second (protocol reference, addendum) never wait: not for their rate, and
    not for a turn among those who send more than their own share."""
    clock = Watch()
    rates = InputRates(1000.0, clock)
    client = rates.newcomer()
    own = rates.own(client)
    waits = []
    for _ in range(180 * 60):
        clock.now += 1.0 / 180.0
        waits += [client.spend(1.0), own.spend(max(1.0, work_cost(90e-6)))]
    assert max(waits) == 0.0


def test_a_flooder_gets_its_rate_and_has_nothing_of_its_own() -> None:
    """It is read at the rate at most; two seconds after it has stopped, its own share is back."""
    clock = Watch()
    rates = InputRates(1000.0, clock)
    client = rates.newcomer()
    own = rates.own(client)
    client.spend(2000.0)  # spends the grant
    begun, got = clock.now, 0.0
    while clock.now < begun + 30.0:
        clock.now += client.spend(60.0)
        own.spend(60.0)
        got += 60.0
    assert got / (clock.now - begun) == pytest.approx(1000.0, rel=0.1)
    assert own.tokens < 0.0
    clock.now += 2.0
    assert own.tokens >= 0.0


def test_commands_that_take_long_count_as_several() -> None:
    """A scan costs several commands, a DRIVE less than one; a model that grows is not paid for."""
    assert work_cost(25e-6) < 1.0
    assert work_cost(1e-3) == pytest.approx(10.0)
    assert work_cost(10.0) == work_cost(1.0) == pytest.approx(1000.0)


def test_clients_that_come_again_and_again_get_no_new_burst() -> None:
    """The first commands of new clients come out of one purse; after 64 of them it is empty."""
    clock = Watch()
    rates = InputRates(1000.0, clock)
    grants = [rates.newcomer().tokens for _ in range(80)]
    assert grants[:64] == [1000.0] * 64
    assert grants[64:] == [0.0] * 16
    clock.now += 1.0
    assert rates.newcomer().tokens == pytest.approx(1000.0)


FLOOD = b"DRIVE {Left 1.00}\r\n"


def test_flood_is_read_at_the_rate_and_nothing_is_lost(control, caplog) -> None:
    """1600 commands at 400 a second take three seconds after the first 400; others are served."""
    server = control(ControlLimits(rate=400.0))
    client, session = server.pair()
    other, _ = server.pair()
    begun = time.monotonic()
    client.send(FLOOD * 1600 + b"GETCONF {Name done}\r\n")
    other.send(b"GETCONF {Name other}\r\n")
    assert other.line() == b"CONF {Name other}\r\n"
    assert len(session.commands) < 1600
    client.socket.settimeout(PATIENCE)
    assert client.line() == b"CONF {Name done}\r\n"
    assert time.monotonic() - begun > 2.5
    assert words(session) == ["DRIVE"] * 1600 + ["GETCONF"]
    [record] = [one for one in caplog.records if "too fast" in one.getMessage()]
    assert record.usarsim_facts["connection"] == session.peer
    assert eventually(lambda: server.service._rates.waiting == 0)


def test_costly_commands_wait_for_their_turn_and_nobody_else_does(control) -> None:
    """Who has used up what is its own gets a part of a processor, here next to nothing; others are
    served at once, and those who take turns with it are not forgotten."""
    server = control(ControlLimits(share=1e-6))
    client, session = server.pair()
    session.cost = 2e-3
    client.send(FLOOD * 3000)
    assert eventually(lambda: server.service._rates.waiting == 1)
    executed = len(session.commands)
    assert executed < 300, "it has been read on credit"
    other, _ = server.pair()
    for number in range(20):
        other.send(b"GETCONF {Name %d}\r\n" % number)
        assert other.line() == b"CONF {Name %d}\r\n" % number
    assert len(session.commands) == executed
    assert session.closes == 0


def test_nobody_waits_for_commands_that_wait_already(control) -> None:
    """What a client sends before its first command is done cannot be told in time: little is read,
    and all of it is executed."""
    server = control(ControlLimits(), hold=True)
    client, session = server.pair()
    client.send(FLOOD * 3000)
    assert eventually(lambda: session.backlog > 64)
    time.sleep(0.1)
    assert session.backlog <= 64 + 2048 // len(FLOOD) + 1
    session.hold = False
    session.release()
    assert eventually(lambda: len(session.commands) == 3000)


def test_without_a_rate_nothing_is_charged(control) -> None:
    """In lockstep and at the fastest pace wall time must not decide what is read when."""
    server = control(ControlLimits(rate=math.inf, share=1e-6))
    client, session = server.pair()
    session.cost = 1.0
    client.send(FLOOD * 5000 + b"GETCONF {Name done}\r\n")
    assert client.line() == b"CONF {Name done}\r\n"
    assert len(session.commands) == 5001


def test_requests_with_long_answers_cost_more(control) -> None:
    """A client is charged for what it makes the server say, too."""
    server = control(ControlLimits(rate=400.0))
    client, session = server.pair()
    answer = b"GEO {Name x}" + b"x" * 1200 * 1024 + b"\r\n"
    session.outbox.put_reply(answer)
    assert client.line() == answer
    begun = time.monotonic()
    client.send(b"GETCONF {Name 1}\r\n")
    assert client.line() == b"CONF {Name 1}\r\n"
    client.send(b"GETCONF {Name 2}\r\n")
    assert client.line() == b"CONF {Name 2}\r\n"
    assert time.monotonic() - begun > 0.8


@pytest.mark.parametrize("end", [Client.close, Client.reset])
def test_client_that_is_held_back_may_go(control, end) -> None:
    """Protocol 13 and 14: to have sent too much delays no goodbye."""
    server = control(ControlLimits(rate=200.0))
    client, session = server.pair()
    client.send(b"{}ACT" * 4000 + b"\r\n")
    assert eventually(lambda: server.service._rates.waiting == 1)
    end(client)
    assert eventually(lambda: session.closes == 1)
    assert eventually(lambda: server.service._rates.waiting == 0)


def test_stop_does_not_wait_for_clients_that_are_held_back(control, caplog, monkeypatch) -> None:
    """A server that ends forgets what they owe."""
    monkeypatch.setattr(listener_module, "_STOP_TIMEOUT", PATIENCE)
    server = control(ControlLimits(rate=200.0))
    client, session = server.pair()
    client.send(b"{}ACT" * 4000 + b"\r\n")
    assert eventually(lambda: server.service._rates.waiting == 1)
    server.stop_service()
    assert session.closes == 1
    assert "connections did not end in time" not in caplog.messages


# Connections of one address


def test_connections_of_one_address_are_limited(control, caplog) -> None:
    """The third of an address reads nothing but the end; another address has places of its own."""
    server = control(ControlLimits(per_address=2))
    first, _ = server.connect(), server.connect()
    assert server.connect(greet=False).line() == b""
    [record] = [one for one in caplog.records if "too many clients of one" in one.getMessage()]
    assert record.usarsim_facts["limit"] == 2
    assert visitor(server).line() == GREETING
    first.close()
    assert eventually(lambda: server.service.connections == 2)
    assert server.connect()


def test_new_connections_of_one_address_wait_for_their_turn(control, caplog) -> None:
    """Three a second after the first four; nobody is refused, other addresses do not notice."""
    server = control(ControlLimits(arrival_rate=3.0, arrival_burst=4))
    begun = time.monotonic()
    many = [server.connect(greet=False) for _ in range(8)]
    assert visitor(server).line() == GREETING
    assert [client.line() for client in many] == [GREETING] * 8
    assert time.monotonic() - begun > 1.2
    assert any("too many new ones" in one.getMessage() for one in caplog.records)


def test_who_only_knocks_does_not_lengthen_the_queue(control) -> None:
    """A hundred connections given up at once delay a later one by two turns, not by a hundred."""
    server = control(ControlLimits(max_connections=200, arrival_rate=1.0, arrival_burst=2))
    for _ in range(100):
        server.connect(greet=False).close()
    late = server.connect(greet=False)
    late.socket.settimeout(PATIENCE)
    assert late.line() == GREETING


def test_who_leaves_the_queue_gives_its_place_back(control) -> None:
    """A client that hangs up before its turn is not waited for."""
    server = control(ControlLimits(arrival_rate=0.05, arrival_burst=2))
    first, second = server.connect(), server.connect()
    waiting = server.connect(greet=False)
    assert eventually(lambda: server.service.connections == 3)
    waiting.close()
    assert eventually(lambda: server.service.connections == 2)
    for client in (first, second):
        client.send(b"GETCONF {Name x}\r\n")
        assert client.line() == b"CONF {Name x}\r\n"


def test_refusals_are_spaced(control, monkeypatch) -> None:
    """Somebody who is refused again and again gets only a part of the loop's time."""
    monkeypatch.setattr(listener_module, "_REFUSAL_PAUSE", 0.1)
    server = control(ControlLimits(max_connections=1))
    server.connect()
    begun = time.monotonic()
    refused = [server.connect(greet=False) for _ in range(6)]
    assert all(client.ended() for client in refused)
    assert time.monotonic() - begun > 0.4


# Lines


def test_longest_line_can_be_set(control, caplog) -> None:
    """Protocol 20: a lab may allow longer lines; what is longer still is thrown away."""
    caplog.set_level("INFO", "usarsim")
    server = control(ControlLimits(max_line=100_000))
    client, session = server.pair()
    client.send(b"GETCONF {Name a}".ljust(100_000) + b"\r\n")
    assert client.line() == b"CONF {Name a}\r\n"
    client.send(b"GETCONF {Name b}".ljust(100_001) + b"\r\nGETCONF {Name c}\r\n")
    assert client.line() == b"CONF {Name c}\r\n"
    assert words(session) == ["GETCONF", "GETCONF"]
    [record] = [one for one in caplog.records if "too long" in one.getMessage()]
    assert record.usarsim_facts["limit"] == 100_000


# Robots


def test_gate_lets_a_team_in_at_once_and_then_so_many_a_second() -> None:
    """64 at the same moment, then 20 a second; an address of its own has a gate of its own."""
    clock = Watch()
    gate = SpawnGate(20.0, 64.0, clock)
    for number in range(64):
        gate.admit(f"10.0.0.1:{number}")
    with pytest.raises(SpawnError, match=r"too many robots at once .*spawn_rate is 20"):
        gate.admit("10.0.0.1:99")
    gate.admit("10.0.0.2:1")
    clock.now += 1.0
    for number in range(20):
        gate.admit(f"10.0.0.1:{number}")
    with pytest.raises(SpawnError):
        gate.admit("10.0.0.1:99")


def test_gate_forgets_who_did_not_come() -> None:
    """A class that does not exist takes nobody's turn."""
    gate = SpawnGate(1.0, 1.0, Watch())
    for _ in range(5):
        gate.admit("[::1]:5")
        gate.forget("[::1]:5")
    gate.admit("[::1]:6")
    with pytest.raises(SpawnError):
        gate.admit("[::1]:7")


def test_gate_without_a_rate_is_open() -> None:
    """In lockstep wall time must not decide who comes."""
    gate = SpawnGate(math.inf, 1.0, Watch())
    for _ in range(1000):
        gate.admit("127.0.0.1:1")
