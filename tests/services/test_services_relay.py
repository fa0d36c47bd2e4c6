"""Links of the wireless simulation: bytes, reach, delay and loss (side channels 4.3)."""

from __future__ import annotations

import random
import socket
import struct
import threading
import time

import pytest
from wireless_harness import (
    ENOUGH,
    FAR,
    NEAR,
    Line,
    Robot,
    Running,
    closed,
    received,
    refuses,
    stuff,
)

from usarsim_server.testing import PATIENCE, eventually


class TestRelay:
    def test_bytes_arrive_unchanged_both_ways(self, running: Running) -> None:
        """A megabyte of everything each way at the same time (side channels 73)."""
        mine, theirs = running.robot("A").link(running.robot("B"))
        there, back = (random.Random(n).randbytes(1_000_003) for n in (1, 2))
        got: list[bytes] = []
        threads = [
            threading.Thread(target=mine.sendall, args=(there,)),
            threading.Thread(target=theirs.sendall, args=(back,)),
            threading.Thread(target=lambda: got.append(received(mine, len(back)))),
        ]
        for thread in threads:
            thread.start()
        assert received(theirs, len(there)) == there
        for thread in threads:
            thread.join(PATIENCE)
        assert got == [back]

    def test_ports_lead_to_their_listeners(self, running: Running) -> None:
        """Each relay port ends at the target port it was asked for."""
        a, b = running.robot("A"), running.robot("B", 2)
        for number in (1, 0):
            mine = a.call(a.road_to("B", b.ports[number]))
            mine.sendall(b"%d" % number)
            assert received(b.accept(number), 1) == b"%d" % number

    def test_reverse_lookup(self) -> None:
        """The target learns who is behind a connection; others learn nothing (side channels 74)."""
        with Running(Line(A=0, B=1, C=2)) as running:
            a, b, c = (running.robot(name) for name in "ABC")
            _, theirs = a.link(b)
            port = theirs.getpeername()[1]
            assert b.control.ask(f"REVERSEDNS {{Port {port}}}") == (
                f"REVERSEDNSREPLY {{Port {port}}} {{Robot A}}"
            )
            for other in (a, c):
                assert other.control.ask(f"REVERSEDNS {{Port {port}}}") == (
                    f"REVERSEDNSREPLY {{Port {port}}} {{Error UnknownOrIllegalPort}}"
                )

    def test_links_of_a_pair_are_separate(self, running: Running) -> None:
        """Several connections through one port are links of their own."""
        a, b = running.robot("A"), running.robot("B")
        links = [a.link(b) for _ in range(3)]
        for number, (mine, _) in enumerate(links):
            mine.sendall(b"%d" % number)
        assert [received(theirs, 1) for _, theirs in links] == [b"0", b"1", b"2"]
        links[1][0].close()
        assert closed(links[1][1])
        links[2][1].sendall(b"on")
        assert received(links[2][0], 2) == b"on"

    def test_half_closed_links(self, running: Running) -> None:
        """One side says no more and still hears the other."""
        mine, theirs = running.robot("A").link(running.robot("B"))
        mine.sendall(b"question")
        mine.shutdown(socket.SHUT_WR)
        assert received(theirs, 100) == b"question"
        theirs.sendall(b"answer")
        theirs.close()
        assert received(mine, 100) == b"answer"

    def test_a_target_that_refuses(self, running: Running) -> None:
        """The caller is connected, then hears the end (side channels 4.3)."""
        a, b = running.robot("A"), running.robot("B")
        road = a.road_to("B")
        b.listeners[0].close()
        assert closed(a.call(road))
        assert not refuses(road)

    def test_a_reset_ends_the_other_side(self, running: Running) -> None:
        """A lost peer ends the link on both sides."""
        mine, theirs = running.robot("A").link(running.robot("B"))
        mine.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        mine.close()
        assert closed(theirs)

    def test_a_receiver_that_does_not_read(self, running: Running) -> None:
        """Its sender is stopped by TCP after a bounded amount; other links and GETSS go on."""
        a, b = running.robot("A"), running.robot("B")
        mine, theirs = a.link(b)
        other, there = a.link(b)
        sent = stuff(mine)
        assert sent < ENOUGH
        other.sendall(b"still")
        assert received(there, 5) == b"still"
        assert a.control.ask("GETSS {Robot B}").startswith("SS {Robot B} {Strength -")
        assert len(received(theirs, sent)) == sent


class TestReach:
    def test_out_of_range_and_back(self) -> None:
        """Both sockets close and the port refuses; back again the same port accepts
        (side channels 75)."""
        with Running(Line(A=0, B=NEAR)) as running:
            a, b = running.robot("A"), running.robot("B")
            road = a.road_to("B")
            mine, theirs = a.call(road), b.accept()
            for _ in range(2):
                running.line.places["B"] = FAR
                assert closed(mine)
                assert closed(theirs)
                assert eventually(lambda: refuses(road))
                assert a.road_to("B") == road
                running.line.places["B"] = NEAR
                assert eventually(lambda: not refuses(road))
                b.accept().close()
                mine, theirs = a.call(road), b.accept()
                mine.sendall(b"again")
                assert received(theirs, 5) == b"again"

    def test_a_port_asked_for_out_of_range(self) -> None:
        """DNS answers, the port refuses until the radio reaches."""
        with Running(Line(A=0, B=FAR)) as running:
            a, b = running.robot("A"), running.robot("B")
            road = a.road_to("B")
            assert refuses(road)
            running.line.places["B"] = NEAR
            assert eventually(lambda: not refuses(road))
            b.accept().close()

    def test_only_the_pair_out_of_range_is_cut(self) -> None:
        """A third robot in the middle keeps its links to both."""
        with Running(Line(A=0, B=30, C=NEAR)) as running:
            a, b, c = (running.robot(name) for name in "ABC")
            links = [a.link(b), a.link(c), b.link(c)]
            running.line.places["B"] = 55
            assert closed(links[0][0])
            for mine, theirs in links[1:]:
                mine.sendall(b"x")
                assert received(theirs, 1) == b"x"

    @pytest.mark.parametrize("why", ["gone", "battery"])
    def test_dismissed_robots(self, why: str, running: Running) -> None:
        """Gone from the simulator or without power: control, links and ports close
        (side channels 76)."""
        a, b = running.robot("A"), running.robot("B")
        road = a.road_to("B")
        mine, theirs = a.call(road), b.accept()
        if why == "gone":
            del running.line.places["B"]
        else:
            running.line.empty.add("B")
        assert b.control.ended()
        assert closed(mine)
        assert closed(theirs)
        assert eventually(lambda: refuses(road))
        assert a.control.ask("GETSS {Robot B}").endswith("{Error Robot.Does.Not.Exist}")
        assert a.control.ask("DNS {Robot B}").endswith("{Error NoSuchRobot}")

    def test_hanging_up_unregisters(self, running: Running) -> None:
        """The name is free again and everything of it is closed (side channels 4.2)."""
        a, b = running.robot("A"), running.robot("B")
        mine, _ = a.link(b)
        b.control.socket.close()
        assert closed(mine)
        assert eventually(lambda: tuple(running.wireless._members) == ("A",))
        again = Robot(running, "B")
        mine, theirs = a.link(again)
        mine.sendall(b"x")
        assert received(theirs, 1) == b"x"

    def test_without_propagation_all_is_open(self) -> None:
        """The model `none` links robots that no simulator knows."""
        with Running(Line(), model="none") as running:
            a, b = running.robot("A"), running.robot("B")
            mine, theirs = a.link(b)
            time.sleep(0.3)  # longer than the patience
            mine.sendall(b"x")
            assert received(theirs, 1) == b"x"
            assert a.control.ask("GETSS {Robot B}") == "SS {Robot B} {Strength 0}"


class TestShaping:
    def test_latency(self) -> None:
        """A byte takes the latency, there and back, and order is kept."""
        with Running(Line(A=0, B=1), latency=0.1) as running:
            mine, theirs = running.robot("A").link(running.robot("B"))
            start = time.monotonic()
            mine.sendall(b"ping")
            assert received(theirs, 4) == b"ping"
            theirs.sendall(b"pong")
            assert received(mine, 4) == b"pong"
            assert time.monotonic() - start >= 0.2

    def test_latency_is_simulated_time(self) -> None:
        """At many times the speed it takes that part; at full speed nothing waits."""
        for speed, least in ((300.0, 0.2), (float("inf"), 0.0)):
            with Running(Line(A=0, B=1), speed=speed, latency=60.0) as one:
                mine, theirs = one.robot("A").link(one.robot("B"))
                start = time.monotonic()
                mine.sendall(b"ping")
                assert received(theirs, 4) == b"ping"
                assert least <= time.monotonic() - start < 60.0

    def test_bandwidth_and_loss_keep_the_stream_whole(self) -> None:
        """100 KB at 250 KB/s take 0.4 s at the least, and lost frames only delay."""
        with Running(Line(A=0, B=1), bandwidth=250e3, loss=0.02, retry_delay=0.001) as running:
            mine, theirs = running.robot("A").link(running.robot("B"))
            data = random.Random(3).randbytes(100_000)
            start = time.monotonic()

            def send() -> None:
                mine.sendall(data)
                mine.close()

            sender = threading.Thread(target=send)
            sender.start()
            assert received(theirs, len(data) + 1) == data
            assert time.monotonic() - start >= 0.4
            sender.join(PATIENCE)

    def test_a_shaped_link_is_bounded(self) -> None:
        """A sender faster than the link is stopped."""
        with Running(Line(A=0, B=1), bandwidth=1000) as running:
            mine, _ = running.robot("A").link(running.robot("B"))
            sent = stuff(mine)
            assert sent < ENOUGH
