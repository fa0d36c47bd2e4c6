"""The wireless simulation server over sockets (side channels reference 4, 68 to 77)."""

from __future__ import annotations

import contextlib
import os
import random
from pathlib import Path

import pytest
from wireless_harness import FAR, NEAR, Line, Running, closed, received, refuses

from usarsim_server.services.wireless import WirelessLimits
from usarsim_server.testing import eventually

"""Bytes that no bounded link takes before anybody reads them."""


class TestDialogue:
    def test_init(self) -> None:
        """INIT answers INITREPLY {Status OK} (side channels 68); a second one is refused."""
        with Running(Line(A=0)) as running:
            talker = running.talker()
            assert talker.ask("INIT {Robot A} {Port 3333}") == "INITREPLY {Status OK}"
            refused = "ERROR {Reason Method.Unknown.Or.Can.INIT.only.once}"
            assert talker.ask("INIT {Robot A} {Port 3333}") == refused
            assert talker.ask("LISTEN {Port 1}") == refused
            assert talker.ask("getss {Robot A}") == refused

    @pytest.mark.parametrize("verb", ["GETSS {Robot A}", "DNS {Robot A}", "REVERSEDNS {Port 1}"])
    def test_init_comes_first(self, verb: str) -> None:
        """Any other verb first is told to use INIT (side channels 69)."""
        with Running(Line(A=0)) as running:
            answer = running.talker().ask(verb)
            assert answer == "ERROR {Reason Must.Use.INIT.Method.First}"

    def test_init_may_be_tried_again(self, running: Running) -> None:
        """After each refused INIT another one on the same connection succeeds
        (side channels 70)."""
        running.robot("A")
        talker = running.talker()
        assert talker.ask("INIT {Robot A} {Port 1}") == "ERROR {Reason Robot.Alread.Exists}"
        assert talker.ask("INIT {Robot B} {Port x}") == (
            "ERROR {Reason Ports.List.Must.Be.Integer}"
        )
        assert talker.ask("INIT {Port 1}") == "ERROR {Reason Robot.Name.Must.Not.Be.Empty}"
        assert talker.ask("INIT {Robot B} {Port 1}") == "INITREPLY {Status OK}"

    def test_strengths(self) -> None:
        """Oneself, an unknown robot, one at 10 m, one without place, one at no distance
        (side channels 71)."""
        with Running(Line(A=0, B=10.5, C=0), patience=100) as running:
            a = running.robot("A").control
            for name in ("B", "C", "Ghost"):
                running.robot(name)
            assert a.ask("GETSS {Robot A}") == "SS {Robot A} {Strength INF} {Error SS.To.Self}"
            assert a.ask("GETSS {Robot X}") == (
                "SS {Robot X} {Strength NaN} {Error Robot.Does.Not.Exist}"
            )
            assert a.ask("GETSS {Robot B}") == "SS {Robot B} {Strength -63.1966}"
            assert a.ask("GETSS {Robot Ghost}") == (
                "SS {Robot Ghost} {Strength NaN} {Error Model.Returned.NaN}"
            )
            assert a.ask("GETSS {Robot C}") == (
                "SS {Robot C} {Strength INF} {Error Model.Returned.INF}"
            )

    def test_strength_follows_a_moving_robot(self) -> None:
        """GETSS tells where the robot is now, not where it was."""
        with Running(Line(A=0, B=2)) as running:
            a = running.robot("A").control
            running.robot("B")
            assert a.ask("GETSS {Robot B}").endswith("{Strength -49.67}")
            running.line.places["B"] = 9.0
            assert eventually(lambda: a.ask("GETSS {Robot B}").endswith("{Strength -56.2021}"))

    def test_a_signal_of_lockstep_is_that_of_the_instant(self) -> None:
        """HRI-09: whenever the watch looked; between two instants nothing has changed."""
        limits = WirelessLimits(poll=1000.0)
        with Running(Line(A=0, B=2), limits=limits, looks_again=True) as running:
            a = running.robot("A").control
            running.robot("B")
            running.line.places["B"] = 9.0
            assert a.ask("GETSS {Robot B}").endswith("{Strength -49.67}")
            running.time = 0.1
            assert a.ask("GETSS {Robot B}").endswith("{Strength -56.2021}")

    def test_ports_of_pairs(self, running: Running) -> None:
        """Repeated DNS gives the same port, the way back another one (side channels 72)."""
        a, b = running.robot("A", 2), running.robot("B", 2)
        first = a.road_to("B")
        assert a.road_to("B") == first
        assert a.road_to("B", b.ports[0]) == first
        assert a.road_to("B", b.ports[1]) != first
        assert b.road_to("A") != first

    def test_lookups_that_fail(self, running: Running) -> None:
        """DNS of oneself, of nobody, of a wrong port, of no number (side channels 4.2)."""
        a, b = running.robot("A").control, running.robot("B")
        for name in ("A", "X", "b"):
            assert a.ask(f"DNS {{Robot {name}}}") == (
                f"DNSREPLY {{Robot {name}}} {{Port -1}} {{Error NoSuchRobot}}"
            )
        wrong = b.ports[0] % 60000 + 1
        assert a.ask(f"DNS {{Robot B}} {{Port {wrong}}}") == (
            "DNSREPLY {Robot B} {Port -1} {Error RobotDoesNotListenOnThisPort}"
        )
        assert a.ask("DNS {Robot B} {Port x}") == "ERROR {Reason Port.Must.Be.Integer}"
        assert a.ask("REVERSEDNS") == "ERROR {Reason Port.Must.Be.Integer}"

    def test_what_crashed_the_original(self, running: Running) -> None:
        """Empty lines, bare verbs, and DNS towards a robot without ports do no harm
        (side channels 77)."""
        a = running.robot("A").control
        assert running.talker().ask("INIT {Robot B}") == "INITREPLY {Status OK}"
        assert a.ask("\r\n\r\nGETSS").startswith("SS {Robot } {Strength NaN}")
        assert a.ask("X") == "ERROR {Reason Method.Unknown.Or.Can.INIT.only.once}"
        assert a.ask("DNS {Robot B}") == (
            "DNSREPLY {Robot B} {Port -1} {Error RobotDoesNotListenOnThisPort}"
        )

    def test_requests_in_any_chunking(self) -> None:
        """Several requests in one segment and one in several are answered in order."""
        with Running(Line(A=0, B=2)) as running:
            a = running.robot("A").control
            running.robot("B")
            a.socket.sendall(b"GETSS {Robot A}\r\nGETSS {Robot B}\r\nGETSS {Ro")
            assert "Robot A" in a.line()
            assert "Robot B" in a.line()
            assert "Robot X" in a.ask("bot X}")

    def test_ground_truth_on_the_same_port(self) -> None:
        """A connection that begins with GETPOS or GETOBS is one of ground truth for good."""
        with Running(Line()) as running:
            for verb in ("GETPOS", "getobs {From A} {To B}"):
                talker = running.talker()
                assert talker.ask(verb) == f"TRUTH {verb}"
                assert talker.ask("INIT {Robot A}") == "TRUTH INIT {Robot A}"

    def test_no_more_ports_than_allowed(self) -> None:
        """Beyond the limit DNS fails as in the original, and what there is goes on."""
        limits = WirelessLimits(ports_per_robot=2, poll=0.02)
        with Running(Line(A=0, B=1), limits=limits) as running:
            a, b = running.robot("A"), running.robot("B", 3)
            roads = [a.road_to("B", port) for port in b.ports[:2]]
            answer = a.control.ask(f"DNS {{Robot B}} {{Port {b.ports[2]}}}")
            assert answer == "ERROR {Reason Could.Not.Allocate.Port}"
            assert a.road_to("B", b.ports[0]) == roads[0]

    def test_garbage_disturbs_nobody(self) -> None:
        """Random bytes and over-long lines leave the server and the others alone."""
        with Running(Line(A=0, B=2)) as running:
            a = running.robot("A").control
            running.robot("B")
            noise = running.talker()
            noise.socket.sendall(random.Random(1).randbytes(200_000))
            noise.socket.sendall(b"INIT {Robot " + b"x" * 300_000)
            noise.socket.close()
            assert a.ask("GETSS {Robot B}").endswith("{Strength -49.67}")


class TestRecord:
    def test_events(self, tmp_path: Path) -> None:
        """Registration, links and bytes are on record, in order (side channels 4.6)."""
        file = tmp_path / "events.csv"
        with Running(Line(A=0, B=NEAR), log=file) as running:
            a, b = running.robot("A"), running.robot("B")
            mine, theirs = a.link(b)
            mine.sendall(b"x" * 1000)
            theirs.sendall(b"y" * 10)
            assert len(received(theirs, 1000)) == 1000
            assert len(received(mine, 10)) == 10
            assert eventually(lambda: "DATA_SENT" in file.read_text())
            mine.close()
            theirs.close()
            b.control.socket.close()
            assert eventually(lambda: len(tuple(running.wireless._members)) == 1)
            port = b.ports[0]
        fields = [line.split(",") for line in file.read_text().splitlines()]
        told = [[one[0], *one[2:-1]] for one in fields]
        assert told[0] == ["REGISTERED", "A", "127.0.0.1", str(a.ports[0])]
        for event in (
            ["REGISTERED", "B", "127.0.0.1", str(port)],
            ["IN_RANGE", "A", "B", "-62.9847", "10"],
            ["CON_ESTABLISHED", "A", "B", "127.0.0.1", str(port)],
            ["DATA_SENT", "A", "B", "1000"],
            ["DATA_SENT", "B", "A", "10"],
            ["CON_TERMINATED", "A", "B", "127.0.0.1", str(port)],
            ["DEREGISTERED", "B"],
        ):
            assert told.count(event) == 1, event


def test_a_team_of_sixteen_and_a_base_in_full_mesh() -> None:
    """Everybody talks to everybody at the same time, 136 links both ways."""
    names = ["Base", *(f"Robot{n:02d}" for n in range(16))]
    with Running(Line(**{name: float(n) / 10 for n, name in enumerate(names)})) as running:
        team = {name: running.robot(name) for name in names}
        links = [
            (one, other, *team[one].link(team[other]))
            for n, one in enumerate(names)
            for other in names[n + 1 :]
        ]
        assert len(links) == 136
        for one, other, mine, theirs in links:
            mine.sendall(f"{one}>{other}".encode())
            theirs.sendall(f"{other}>{one}".encode())
        for one, other, mine, theirs in links:
            assert received(theirs, len(one) + len(other) + 1).decode() == f"{one}>{other}"
            assert received(mine, len(one) + len(other) + 1).decode() == f"{other}>{one}"


def test_comings_and_goings_leave_nothing_behind(running: Running) -> None:
    """After many registrations, links and outages all sockets but the server's own are closed."""

    def visit() -> None:
        a, b = running.robot("A"), running.robot("B")
        ends = [*a.link(b), *b.link(a)]
        running.line.places["B"] = FAR
        assert all(map(closed, ends))
        running.line.places["B"] = NEAR
        for end in (*ends, *a.listeners, *b.listeners, a.control.socket, b.control.socket):
            end.close()
        assert eventually(lambda: tuple(running.wireless._members) == ())

    def descriptors() -> int:
        return len(os.listdir("/proc/self/fd"))

    visit()
    before = descriptors()
    for _ in range(10):
        visit()
    assert eventually(lambda: descriptors() <= before)


def test_stopping_ends_everything() -> None:
    """Links, ports and control connections are gone when the service has stopped."""
    running = Running(Line(A=0, B=1))
    a, b = running.robot("A"), running.robot("B")
    road = a.road_to("B")
    mine, theirs = a.call(road), b.accept()
    running.call(running.wireless.stop())
    assert closed(mine)
    assert closed(theirs)
    assert a.control.ended()
    assert refuses(road)
    assert refuses(running.port)
    running.stop()


class TestWhoMayRegister:
    """A robot's name belongs to the machine of its control connection."""

    def test_a_name_of_somebody_elses_robot_is_refused(self) -> None:
        """Whatever its case; another name on the same connection works."""
        with Running(Line(A=0, B=0), owners={"a": "192.0.2.7"}) as running:
            talker = running.talker()
            for name in ("A", "a"):
                answer = talker.ask(f"INIT {{Robot {name}}} {{Port 1}}")
                assert answer == "ERROR {Reason Robot.Alread.Exists}"
            assert talker.ask("INIT {Robot B} {Port 1}") == "INITREPLY {Status OK}"

    def test_the_robot_of_the_same_machine_is_welcome(self) -> None:
        """Also if one connection came by 127.0.0.1 and the other by 127.0.0.2."""
        with Running(Line(A=0), owners={"a": "127.0.0.2"}) as running:
            answer = running.talker().ask("INIT {Robot A} {Port 1}")
            assert answer == "INITREPLY {Status OK}"

    def test_who_came_before_the_robot_has_to_go(self) -> None:
        """A name is everybody's until there is a robot of that name; then its owner's."""
        with Running(Line(), model="none") as running:
            squatter = running.talker()
            assert squatter.ask("INIT {Robot A} {Port 1}") == "INITREPLY {Status OK}"
            running.owners["a"] = "192.0.2.7"
            assert squatter.ended()

    def test_strict_radio_knows_robots_only(self) -> None:
        """A name of nobody is refused, and a robot registers once, whatever the case."""
        owners = {"a": "127.0.0.1"}
        with Running(Line(A=0), strict=True, owners=owners, model="none") as running:
            refused = "ERROR {Reason Robot.Alread.Exists}"
            assert running.talker().ask("INIT {Robot B} {Port 1}") == refused
            talker = running.talker()
            assert talker.ask("INIT {Robot A} {Port 1}") == "INITREPLY {Status OK}"
            assert running.talker().ask("INIT {Robot a} {Port 1}") == refused

    @pytest.mark.parametrize("name", ["x" * 65, "x" * 60_000])
    def test_a_name_that_is_too_long_is_none(self, name: str) -> None:
        """Longer than any robot's; the connection lives on."""
        with Running(Line(A=0)) as running:
            talker = running.talker()
            answer = talker.ask(f"INIT {{Robot {name}}} {{Port 1}}")
            assert answer == "ERROR {Reason Robot.Name.Must.Not.Be.Empty}"
            assert talker.ask("INIT {Robot A} {Port 1}") == "INITREPLY {Status OK}"

    def test_names_are_cleaned_like_those_of_robots(self) -> None:
        """Blanks and control characters reach nobody else."""
        with Running(Line(), model="none") as running:
            assert running.talker().ask("INIT {Robot Bell\x07 b} {Port 1}").endswith("OK}")
            assert tuple(running.wireless._members) == ("Bell__b",)

    def test_ports_without_number_are_refused(self) -> None:
        """As many as a list can name."""
        with Running(Line(A=0)) as running:
            ports = ",".join(["1"] * 257)
            answer = running.talker().ask(f"INIT {{Robot A}} {{Port {ports}}}")
            assert answer == "ERROR {Reason Ports.List.Must.Be.Integer}"


class TestQuotas:
    def test_links_of_one_robot(self) -> None:
        """Beyond the limit they end as they are made; others have theirs, and ends make room."""
        limits = WirelessLimits(links_per_robot=2, poll=0.02)
        with Running(Line(A=0, B=1), limits=limits) as running:
            a, b = running.robot("A"), running.robot("B")
            road = a.road_to("B")
            links = [a.link(b) for _ in range(2)]
            assert closed(a.call(road))
            b.link(a)
            for end in links[0]:
                end.close()

            def passes() -> bool:
                mine = a.call(road)
                mine.settimeout(0.1)
                try:
                    return mine.recv(1) != b""
                except TimeoutError:
                    return True

            assert eventually(passes)

    def test_few_descriptors(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Ports and links get half of what the process may open, so that others go on."""
        monkeypatch.setattr("usarsim_server.services.wireless.descriptor_limit", lambda: 16)
        with Running(Line(A=0, B=1)) as running:
            a, b = running.robot("A"), running.robot("B", 8)
            for _ in range(2):
                a.link(b)
            assert closed(a.call(a.road_to("B")))
            answers = [a.control.ask(f"DNS {{Robot B}} {{Port {port}}}") for port in b.ports]
            assert answers.count("ERROR {Reason Could.Not.Allocate.Port}") >= 4


def test_ground_truth_can_be_kept_secret() -> None:
    """Without it GETPOS is what the original took it for, a request before INIT."""
    with Running(Line(A=0), tells_truth=False) as running:
        talker = running.talker()
        for verb in ("GETPOS", "GETOBS {From A} {To A}"):
            assert talker.ask(verb) == "ERROR {Reason Must.Use.INIT.Method.First}"
        assert talker.ask("INIT {Robot A} {Port 1}") == "INITREPLY {Status OK}"


def test_a_flood_of_requests_is_answered_and_others_are_too(running: Running) -> None:
    """Thirty that ask without reading: somebody who asks now and then has his answer."""
    running.robot("A")
    for number in range(30):
        one = running.talker()
        one.socket.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            for _ in range(20):
                one.socket.send((b"GETPOS %d\r\n" % number) * 200)
    b = running.robot("B")
    for _ in range(10):
        assert b.control.ask("GETSS {Robot A}").startswith("SS {Robot A} {Strength -")
