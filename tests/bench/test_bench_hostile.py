"""A team beside attackers: what is counted, what is judged, and that the attackers do attack."""

from __future__ import annotations

import dataclasses
import socket
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from bench_fakes import FakeServer

from usarsim_bench.hostile import measuring, web_servers
from usarsim_bench.hostile.attack import MIB, Attack
from usarsim_bench.hostile.attackers import ATTACKS, Attackers
from usarsim_bench.hostile.control_attacks import CONTROL_ATTACKS
from usarsim_bench.hostile.links import Damage, Link, Site, work
from usarsim_bench.hostile.measuring import HEADS, Outcome, Span, outcome_row, verdict
from usarsim_bench.hostile.newcomers import QUESTIONS, Newcomers
from usarsim_bench.hostile.scene_attacks import SCENE_ATTACKS
from usarsim_bench.hostile.side_attacks import SIDE_ATTACKS
from usarsim_bench.hostile.tally import Tally, intervals
from usarsim_bench.hostile.web_attacks import WEB_ATTACKS
from usarsim_bench.hostile.web_servers import WebServers
from usarsim_bench.server import BenchError
from usarsim_server.cli import main
from usarsim_server.testing import eventually


def status(time: float) -> bytes:
    """A line that bears a time."""
    return b"STA {Type GroundVehicle} {Time %.2f} {Battery 1}\r\n" % time


ODOMETRY = b"SEN {Type Odometry} {Name Odo} {Pose 1,2,3}\r\n"
EVEN = [(10.0 + 0.1 * n, status(0.1 * n) + ODOMETRY * (n % 2)) for n in range(100)]


class TestIntervals:
    def test_are_those_of_simulated_time(self) -> None:
        """Lines without a time are dated by the line before; the wall clock does not matter."""
        slow = [(3.0 * moment, data) for moment, data in EVEN]
        for chunks in (EVEN, slow):
            assert intervals(chunks) == pytest.approx({"STA": 0.1, "Odometry Odo": 0.2})

    def test_need_lines(self) -> None:
        """Nobody, and a stream of one line."""
        with pytest.raises(BenchError, match="nobody"):
            intervals([])
        with pytest.raises(BenchError, match="too few lines of STA"):
            intervals(EVEN[:1])


class TestTally:
    def tally(self, chunks: Sequence[tuple[float, bytes]], pieces: int = 1) -> Tally:
        """The tally of ten seconds, fed in so many portions."""
        tally = Tally(10.0, {"STA": 0.1})
        size = max(1, len(chunks) // pieces)
        for start in range(0, len(chunks), size):
            tally.digest(chunks[start : start + size])
        tally.end(20.0)
        return tally

    def test_an_even_stream_is_whole(self) -> None:
        """A hundred lines of ten seconds, real time, and no silence longer than usual."""
        tally = self.tally(EVEN)
        assert (tally.count, tally.lost) == (100, 0)
        assert tally.factor == pytest.approx(1.0)
        assert tally.gap == pytest.approx(0.0)

    def test_lines_that_are_left_out_are_missed(self) -> None:
        """Nine of ten lines, and a silence of two periods."""
        tally = self.tally([one for n, one in enumerate(EVEN) if n % 10])
        assert (tally.count, tally.lost) == (90, 9)
        assert tally.gap == pytest.approx(0.1)

    def test_a_slow_world_loses_nothing(self) -> None:
        """All lines at half the speed: the factor tells, nothing is lost."""
        tally = self.tally([(10.0 + 2.0 * (moment - 10.0), data) for moment, data in EVEN[:50]])
        assert (tally.count, tally.lost) == (50, 0)
        assert tally.factor == pytest.approx(0.5)

    def test_a_stream_that_dies_is_found(self) -> None:
        """Half of the lines, and silence until the end."""
        tally = self.tally(EVEN[:50])
        assert tally.count == 50
        assert tally.gap == pytest.approx(5.0)

    def test_lines_cut_between_two_portions_count_once(self) -> None:
        """However the bytes come in."""
        whole = b"".join(data for _, data in EVEN)
        cut = [(11.0 + place / 1e4, whole[place : place + 7]) for place in range(0, len(whole), 7)]
        assert self.tally(cut, pieces=40).count == 100

    def test_spans(self) -> None:
        """What came before does not count; what is lost between two spans does, in the second."""
        early = [(moment - 5.0, data) for moment, data in EVEN]
        tally = self.tally(early)
        assert tally.count == 50
        tally.begin(20.0)
        tally.digest([(20.0, status(10.2)), (20.1, status(10.3))])
        assert (tally.count, tally.lost) == (2, 2)

    def test_nothing_came(self) -> None:
        """A factor of nothing, not an error."""
        assert self.tally([]).factor == 0.0


QUIET = Span(1000.0, 1.0, 0, 0.01, 0.4, 300, 300, 50)
GOOD = Outcome(ATTACKS["drive"], QUIET, QUIET, QUIET, Damage(), (0.1, "control"), (), 0.5)


class TestVerdict:
    def test_nothing_has_changed(self) -> None:
        """The promise is kept, and the row says so."""
        assert verdict(GOOD) == []
        row = outcome_row(GOOD)
        assert len(row) == len(HEADS)
        assert (row[0], row[1], row[-1]) == ("drive", "1.000", "yes")

    @pytest.mark.parametrize(
        ("changed", "broken"),
        [
            ({"rate": 940.0}, "rate"),
            ({"rate": float("nan")}, "rate"),
            ({"lost": 1}, "lines lost"),
            ({"peak": int(300 + 65 * MIB)}, "memory (promised 64 MiB)"),
            ({"descriptors": 5000}, "5000 descriptors"),
        ],
    )
    def test_what_the_team_saw(self, changed: dict[str, float], broken: str) -> None:
        """Each thing promised is judged by itself."""
        during = dataclasses.replace(QUIET, **changed)  # type: ignore[arg-type]
        outcome = dataclasses.replace(GOOD, during=during)
        assert verdict(outcome) == [broken]
        assert outcome_row(outcome)[-1] == f"NO: {broken}"

    def test_a_busy_machine_is_told(self) -> None:
        """A rate that fell where the quiet spans were no better is in doubt, and says so."""
        slow = dataclasses.replace(QUIET, rate=900.0)
        busy = dataclasses.replace(QUIET, factor=0.8)
        outcome = dataclasses.replace(GOOD, during=slow, after=busy)
        assert verdict(outcome) == ["rate? without attack the factor was 0.80"]

    def test_what_others_saw(self) -> None:
        """A new client that waits, forged answers, and a server that does not end."""
        outcome = dataclasses.replace(
            GOOD, wait=(9.0, "truth"), faults=("truth: forged fields",), end=float("inf")
        )
        assert verdict(outcome) == ["new client on truth", "end", "truth: forged fields"]

    def test_overload_is_judged_by_losses(self) -> None:
        """A machine with too much to do may be slow, not forgetful."""
        slow = dataclasses.replace(QUIET, rate=100.0, lost=3)
        outcome = dataclasses.replace(GOOD, attack=ATTACKS["busy-machine"], during=slow)
        assert verdict(outcome) == ["lines lost"]


def run(links: Sequence[Link], seconds: float = 0.5) -> Damage:
    """Let links work for a while."""
    ended, damage = threading.Event(), Damage()
    threading.Timer(seconds, ended.set).start()
    work(links, ended, damage)
    return damage


class TestLinks:
    def test_say_something_first_and_then_again(self) -> None:
        """Each connection has its number; what is said again comes at its pace."""
        with FakeServer() as server:
            run([Link(server.port, lambda n: b"INIT %d\r\n" % n, b"HELLO\r\n", every=0.05)])
            assert server.commands("INIT", 1) == ["INIT 0"]
            assert 3 <= len(server.commands("HELLO", 3)) <= 10

    def test_come_back(self) -> None:
        """After their life, and after the server has hung up."""
        with FakeServer() as server:
            damage = run([Link(server.port, lambda n: b"INIT %d\r\n" % n, lives=0.1)])
            assert damage.connections >= 3
            assert server.commands("INIT 2", 1)
            link = Link(server.port, b"STAYS\r\n", reads=True)
            threading.Timer(0.3, server.hang_up).start()
            damage = run([link], 1.5)
            assert (damage.connections, damage.closed) == (2, 1)

    def test_cost_little(self) -> None:
        """A flood that is taken at once stays within the share of a processor."""
        sink = socket.create_server(("127.0.0.1", 0))

        def swallow() -> None:
            client, _ = sink.accept()
            with client:
                while client.recv(1 << 20):
                    pass

        threading.Thread(target=swallow, daemon=True).start()
        with sink:
            damage = run([Link(sink.getsockname()[1], again=b"x")], 1.0)
        assert damage.sent > 1_000_000
        assert damage.cpu < 0.3 * damage.seconds

    def test_without_a_server(self) -> None:
        """Nobody listens: they try again and do not fail."""
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        damage = run([Link(port, b"X"), Link(port, reads=True)], 0.8)
        assert damage.sent == damage.received == 0
        assert damage.closed == damage.connections == 4


class TestAttacks:
    def test_names_are_unique(self) -> None:
        """No attack hides another."""
        groups = (CONTROL_ATTACKS, SIDE_ATTACKS, SCENE_ATTACKS, WEB_ATTACKS)
        assert len(ATTACKS) == sum(map(len, groups))

    @pytest.mark.parametrize("attack", ATTACKS.values(), ids=lambda one: one.name)
    def test_ask_newcomers_where_they_attack(self, attack: Attack) -> None:
        """Every port named has a question, and a sentence says what is done."""
        assert set(attack.ports) <= set(QUESTIONS)
        assert attack.what

    @pytest.mark.parametrize(
        "attack", [*CONTROL_ATTACKS, *SCENE_ATTACKS, *WEB_ATTACKS], ids=lambda one: one.name
    )
    def test_links_can_be_made(self, attack: Attack) -> None:
        """Without anybody to attack: nothing is sent before they are worked."""
        ports = dict.fromkeys(QUESTIONS, 1)
        assert attack.links(Site(ports)) or attack.overload

    def test_are_called_back(self) -> None:
        """They run in a process of their own and tell what they did."""
        with FakeServer() as server, Attackers("medley", {"control": server.port}) as attackers:
            server.commands("GETSTARTPOSES", 1)
            damage = attackers.stop()
        assert damage.connections >= 1
        attackers.close()

    def test_that_fail_say_why(self) -> None:
        """No such port: the last line of their complaint is the reason."""
        with Attackers("medley", {}) as attackers, pytest.raises(BenchError, match="KeyError"):
            attackers.stop()


POSITIONS = b"POSITIONS {Robots 2} {Name %s Location 1.0,2.0,3.0 BatteryEmpty False} "
POSITIONS += b"{Name R2 Location 0.0,0.0,0.0 BatteryEmpty False}\r\n"
LISTING = b"{Name %s} {Class P3AT} {Time 1.0} {Location 1,2,3} {Rotation 0,0,0}\r\n{End}\r\n"


class TestFaults:
    @pytest.mark.parametrize("name", [b"R1", b"Evil_Location_9,9,0", b"\xe9t\xe9"])
    def test_tokens_are_names(self, name: bytes) -> None:
        """What looks odd but is one printable token forges nothing."""
        answers = {"groundtruth": POSITIONS % name, "truth": LISTING % name}
        assert not ATTACKS["names"].faults(answers)

    @pytest.mark.parametrize(
        ("name", "fault"),
        [
            (b"Evil Location 9,9,0", "forged fields"),
            (b"Evil} {Name R3", "forged fields"),
            (b"r2", "two robots of one name"),
            (b"Bell\x07", "control characters"),
        ],
    )
    def test_lists_that_lie(self, name: bytes, fault: str) -> None:
        """Each way to forge a list of positions is found."""
        found = ATTACKS["names"].faults({"groundtruth": POSITIONS % name})
        assert f"groundtruth: {fault}" in found

    def test_listings_that_lie(self) -> None:
        """The same for scoring tools."""
        (fault,) = ATTACKS["names"].faults({"truth": LISTING % b"Evil} {Location 9,9,9"})
        assert fault.startswith("truth: forged line")

    def test_truth_that_is_off(self) -> None:
        """Nobody tells where robots are, on no port and by no sensor."""
        faults = ATTACKS["truth-off"].faults
        assert not faults({"wireless": b"POSITIONS {Robots 0}\r\n", "team": b"STA Odometry"})
        assert len(faults({"wireless": POSITIONS % b"R1", "team": b"GroundTruth GndTruth"})) == 2


class TestWebServers:
    """The console and the desk that are attacked."""

    def test_answer_who_has_a_token(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """An operator and an experimenter load their pages, and nothing is wrong; what may be is
        found: memory, processor, a log that fills."""
        with FakeServer() as server, WebServers(server.port) as web:
            with Newcomers(web.ports, list(web.ports)) as newcomers:
                assert eventually(lambda: len(newcomers.answers) == len(web.ports))
            assert all(b"HTTP/1.1 101" in answer for answer in newcomers.answers.values())
            assert web.faults() == []
            monkeypatch.setattr(web_servers, "MOST_GROWTH", -1e12)
            monkeypatch.setattr(web_servers, "MOST_CORES", -1.0)
            monkeypatch.setattr(web_servers, "LINES", -1e6)
            found = web.faults()
        for what in ("memory", "processor", "lines"):
            assert [one for one in found if what in one and "console" in one], what


class TestNewcomers:
    def test_are_answered(self) -> None:
        """The wait and the answer are written down."""
        with FakeServer() as server, Newcomers({"control": server.port}, ["control"]) as newcomers:
            assert eventually(lambda: bool(newcomers.answers))
        assert b"{StartPoses" in newcomers.answers["control"]
        assert newcomers.slowest[1] == "control"

    def test_wait_in_vain(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Nobody answers: what they waited until the end counts."""
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        with Newcomers({"control": port}, ["control"]) as newcomers:
            time.sleep(0.5)
        assert newcomers.slowest[0] > 0.3
        assert not newcomers.answers


@pytest.mark.slow
def test_measurement(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two robots beside two attacks, in full: the table is there, in all three forms."""
    monkeypatch.setattr(measuring, "SETTLE", 1.0)
    data, page = tmp_path / "r.json", tmp_path / "r.md"
    words = ["--robots", "2", "--seconds", "1.5", "--world", "empty"]
    files = ["--json", str(data), "--markdown", str(page)]
    assert main(["bench", "hostile", *words, *files, "--attack", "drip", "registry"]) == 0
    out = capsys.readouterr().out
    assert "promise kept" in out
    assert "Attacks whose promise is kept" in out
    assert "| registry |" in page.read_text()
    assert '"heads"' in data.read_text()
