"""Radio links count what really arrives; ground truth is asked and timed."""

from __future__ import annotations

import socket
import threading
import time

import pytest

from usarsim_bench import groundtruth
from usarsim_bench.groundtruth import Asker
from usarsim_bench.relay import Radio, Traffic, round_trips, throughput
from usarsim_bench.server import BenchError
from usarsim_server.testing import PATIENCE, eventually


def pair() -> tuple[socket.socket, socket.socket]:
    """Two connected TCP sockets."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        mine = socket.create_connection(listening.getsockname(), timeout=PATIENCE)
        theirs, _ = listening.accept()
    theirs.settimeout(PATIENCE)
    return mine, theirs


def test_throughput_counts_what_arrives() -> None:
    """A receiver's figure is positive, and the stream is read to its end."""
    mine, theirs = pair()
    with mine, theirs:
        assert throughput(mine, theirs, 0.1) > 0.0
        assert theirs.recv(1) == b""


def test_round_trips_include_the_way() -> None:
    """A link that holds messages back for 20 ms one way shows it."""
    mine, there = pair()
    back, theirs = pair()

    def pass_on(source: socket.socket, target: socket.socket, delay: float) -> None:
        while data := source.recv(1000):
            time.sleep(delay)
            target.sendall(data)

    ways = [
        threading.Thread(target=pass_on, args=ends, daemon=True)
        for ends in ((there, back, 0.02), (back, there, 0.0))
    ]
    for way in ways:
        way.start()
    taken = round_trips(mine, theirs, 3)
    assert len(taken) == 3
    assert min(taken) >= 0.02
    mine.close()
    theirs.close()
    for way in ways:
        way.join(PATIENCE)
    there.close()
    back.close()


def test_traffic_is_even_and_counted() -> None:
    """Every tick each link carries its share, and all of it is missed if it does not arrive."""
    links = [pair() for _ in range(3)]
    with Traffic(links, 20_000) as traffic:
        assert eventually(lambda: traffic.sent >= 6000)
    assert traffic.sent == traffic.received
    assert traffic.sent % 3000 == 0
    assert len(traffic.delays) == traffic.sent // 1000
    assert all(delay >= 0.0 for delay in traffic.delays)
    for ends in links:
        for end in ends:
            end.close()


def test_a_lost_link_is_told() -> None:
    """A base that loses its link fails the measurement."""
    mine, theirs = pair()
    mine.shutdown(socket.SHUT_WR)
    traffic = Traffic([(mine, theirs)], 1000)
    traffic._thread.join(PATIENCE)
    with pytest.raises(BenchError, match="was lost"):
        traffic.close()
    mine.close()
    theirs.close()


def test_a_refused_registration_is_told() -> None:
    """What the server says instead of OK is in the error."""
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def refuse() -> None:
            client, _ = listening.accept()
            with client:
                client.recv(1000)
                client.sendall(b"ERROR {Reason Robot.Alread.Exists}\r\n")

        threading.Thread(target=refuse, daemon=True).start()
        with pytest.raises(BenchError, match=r"Robot\.Alread\.Exists"):
            Radio(listening.getsockname()[1], "A")


def oracle(count: str = "1.0000") -> int:
    """A port that answers like ground truth about any robots; for one client."""
    listening = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        client, _ = listening.accept()
        with listening, client, client.makefile("rb") as lines:
            for line in lines:
                words = line.decode().strip()
                if words == "GETPOS":
                    reply = "POSITIONS {Robots 2} {Name A ...}"
                else:
                    reply = f"NUMOBS {words.removeprefix('GETOBS ')} {{ObstCount {count}}}"
                client.sendall(f"{reply}\r\n".encode())

    threading.Thread(target=serve, daemon=True).start()
    port: int = listening.getsockname()[1]
    return port


def test_asker_asks_for_positions_and_all_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """One round is a question for everybody and one for each ordered pair."""
    monkeypatch.setattr(groundtruth, "TURN", 0.02)
    with Asker(oracle(), ["A", "B", "C"]) as asker:
        while len(asker.positions) < 3:
            threading.Event().wait(0.005)
    assert 12 <= len(asker.obstacles) <= 6 * len(asker.positions)
    assert all(taken > 0.0 for taken in (*asker.positions, *asker.obstacles))


def test_an_unknown_robot_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fast wrong answers do not count: the measurement fails."""
    monkeypatch.setattr(groundtruth, "TURN", 0.02)
    asker = Asker(oracle("-1.0000"), ["A", "B"])
    asker._thread.join(60.0)
    with pytest.raises(BenchError, match=r"GETOBS .* was answered"):
        asker.close()
