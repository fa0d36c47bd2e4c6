"""The ComServer over sockets (side channels reference 5, 79 to 87)."""

from __future__ import annotations

import random
import socket
from collections.abc import Iterator

import pytest
from wireless_harness import FAR, NEAR, Line, Running, Talker, closed, received

from usarsim_server.services.comserver import ComServerLimits
from usarsim_server.testing import PATIENCE, eventually


class Team:
    """Two robots that listen for the server, and a control connection."""

    def __init__(self, running: Running) -> None:
        self.running = running
        self.talker: Talker = running.com_talker()
        self.listeners = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
        running.clients += self.listeners
        self.a, self.b = (one.getsockname()[1] for one in self.listeners)

    def say(self, message: str) -> str:
        """Send a message, read the answer."""
        return self.talker.message(message.encode()).decode()

    def introduce(self) -> None:
        """Register both; B listens."""
        for message in ("REGISTER A 127.0.0.1;", "REGISTER B 127.0.0.1;", f"LISTEN B {self.b};"):
            assert self.say(message) == "OK;"

    def open(self) -> tuple[socket.socket, socket.socket]:
        """A data link: A's end and B's."""
        assert self.say(f"OPEN A {self.a} B {self.b};") == "OK;"
        return self.accept(0), self.accept(1)

    def accept(self, number: int) -> socket.socket:
        """Take a connection from the server."""
        self.listeners[number].settimeout(PATIENCE)
        made, _ = self.listeners[number].accept()
        made.settimeout(PATIENCE)
        self.running.clients.append(made)
        return made


@pytest.fixture
def team() -> Iterator[Team]:
    """Two robots side by side, registered; B listens."""
    with Running(Line(A=0, B=1)) as running:
        team = Team(running)
        team.introduce()
        yield team


class TestControl:
    def test_register(self) -> None:
        """OK; without line end, again with the same address, not with another
        (side channels 79)."""
        with Running(Line(A=0)) as running:
            talker = running.com_talker()
            talker.socket.sendall(b"REGISTER A 127.0.0.1;")
            assert talker.socket.recv(100) == b"OK;"
            assert talker.message(b"register A 127.0.0.1;") == b"OK;"
            assert talker.message(b"REGISTER A 10.0.0.1;") == (
                b"Fail: Robot with name A already registered;"
            )

    def test_listen(self) -> None:
        """Only for registered robots, and not twice on the first port (side channels 80)."""
        with Running(Line()) as running:
            team = Team(running)
            assert team.say("LISTEN A 7000;") == "Fail: Robot A not registered;"
            assert team.say("REGISTER A 127.0.0.1;") == "OK;"
            assert team.say("LISTEN A 7000;") == "OK;"
            assert team.say("LISTEN A 7000;") == (
                "Fail: Robot with name A already listening at port 7000;"
            )
            assert team.say("LISTEN A 7001;") == "OK;"

    def test_registrations_outlive_connections(self) -> None:
        """Closing the control connection undoes nothing (side channels 5.1)."""
        with Running(Line(A=0, B=1)) as running:
            team = Team(running)
            team.introduce()
            team.talker.socket.close()
            team.talker = running.com_talker()
            team.open()

    def test_messages_that_are_none(self) -> None:
        """Wrong word counts and unknown verbs have their Fail texts (side channels 87)."""
        with Running(Line()) as running:
            team = Team(running)
            assert team.say("REGISTER A;") == "Fail: Incorrect Message;"
            assert team.say("OPEN A 1 B;") == "Fail: Incorrect Message;"
            for message in ("HELLO;", "SEND 5 hello;", "CLOSE;", ";"):
                assert team.say(message) == "Fail: Unknown Message;"

    def test_pipelined_messages(self) -> None:
        """All messages of a chunk are answered in order."""
        with Running(Line()) as running:
            talker = running.com_talker()
            talker.socket.sendall(b"REGISTER A 127.0.0.1;\r\nLISTEN A 1;LISTEN B 1;")
            answers = [talker.until(b";") for _ in range(3)]
            assert answers == [b"OK", b"OK", b"Fail: Robot B not registered"]

    def test_strength(self) -> None:
        """The strength of the model, for those who are concerned (side channels 86)."""
        with Running(Line(A=0, B=9)) as running:
            team = Team(running)
            team.introduce()
            assert team.say("GETSS A B;") == "OK:-56.2021;"
            assert team.say("GETSS A Ghost;") == "Fail: Could not calculate signal strength;"
            refused = "Fail: Server does not accept third party requests;"
            assert team.say("GETSS Ghost Other;") == refused
            assert team.say("REGISTER C 10.0.0.1;") == "OK;"
            assert team.say("REGISTER D 10.0.0.2;") == "OK;"
            assert team.say("GETSS C D;") == refused

    def test_strength_follows_the_robots(self) -> None:
        """GETSS tells where the robots are now."""
        with Running(Line(A=0, B=9)) as running:
            team = Team(running)
            team.introduce()
            running.line.places["B"] = 2.0
            assert eventually(lambda: team.say("GETSS A B;") == "OK:-49.67;")


class TestLinks:
    def test_payload_only(self, team: Team) -> None:
        """SEND 5 hello; delivers hello to the other, which hears nothing else (side channels 81,
        82)."""
        a, b = team.open()
        a.sendall(b"SEND 5 hello;")
        assert received(b, 5) == b"hello"
        b.sendall(b"SEND 2 hiSEND")  # the byte behind the payload may be any
        assert received(a, 2) == b"hi"

    def test_binary_payload(self, team: Team) -> None:
        """1000 bytes with semicolons and zeros arrive intact, in small pieces, too
        (side channels 83)."""
        a, b = team.open()
        payload = (b";\0" + random.Random(1).randbytes(998))[:1000]
        message = b"SEND 1000 " + payload + b";"
        a.sendall(message)
        assert received(b, 1000) == payload
        for at in range(0, len(message), 7):
            a.sendall(message[at : at + 7])
        assert received(b, 1000) == payload

    @pytest.mark.parametrize("how", ["close", "hang up"])
    def test_close(self, how: str, team: Team) -> None:
        """CLOSE; or the end of one side close both (side channels 84)."""
        a, b = team.open()
        a.sendall(b"SEND 3 bye;")
        if how == "close":
            a.sendall(b"CLOSE;")
            assert closed(a)
        else:
            a.close()
        assert received(b, 4) == b"bye"
        assert closed(b)

    def test_a_port_is_used_up(self, team: Team) -> None:
        """OPEN on a consumed LISTEN entry fails (side channels 85)."""
        team.open()
        assert team.say(f"OPEN A {team.a} B {team.b};") == (
            f"Fail: B not listening on port {team.b};"
        )
        assert team.say("OPEN A 1 Nobody 2;") == "Fail: Nobody not listening on port 2;"

    def test_out_of_reach(self) -> None:
        """OPEN fails and uses nothing up; an open link ends at its next SEND
        (side channels 5.4)."""
        with Running(Line(A=0, B=FAR)) as running:
            team = Team(running)
            team.introduce()
            opening = f"OPEN A {team.a} B {team.b};"
            assert team.say(opening) == "Fail: Cannot connect to B;"
            running.line.places["B"] = NEAR
            assert eventually(lambda: team.say(opening) == "OK;")
            a, b = team.accept(0), team.accept(1)
            a.sendall(b"SEND 1 x;")
            assert received(b, 1) == b"x"
            running.line.places["B"] = FAR
            assert eventually(lambda: team.say("GETSS A B;").startswith("OK:-116"))
            a.sendall(b"SEND 1 y;")
            assert closed(a)
            assert closed(b)

    def test_one_side_refuses(self, team: Team) -> None:
        """If one robot cannot be reached the other is hung up on; OPEN says OK all the same."""
        team.listeners[1].close()
        assert team.say(f"OPEN A {team.a} B {team.b};") == "OK;"
        assert closed(team.accept(0))

    @pytest.mark.parametrize("port", ["0", "65536", "x", "-1", "9" * 60])
    def test_ports_that_are_none(self, port: str, team: Team) -> None:
        """They can be listened on as words, but not be dialled."""
        assert team.say(f"LISTEN B {port};") == "OK;"
        assert team.say(f"OPEN A {team.a} B {port};") == "Fail: Could not establish connection;"
        assert team.say("GETSS A B;").startswith("OK:")

    def test_an_address_that_is_none(self) -> None:
        """A link to it fails, and nothing else."""
        with Running(Line(A=0, B=1)) as running:
            team = Team(running)
            for message in ("REGISTER A 127.0.0.1;", "REGISTER B ::nonsense;", "LISTEN B 7;"):
                assert team.say(message) == "OK;"
            assert team.say(f"OPEN A {team.a} B 7;") == "OK;"
            assert closed(team.accept(0))
            assert team.say("GETSS A B;").startswith("OK:")


class TestRegistry:
    def test_names_of_nobody_give_way(self) -> None:
        """When there are too many the oldest that is no robot is forgotten; robots stay."""
        limits = ComServerLimits(poll=0.02, robots=4)
        with Running(Line(), com_limits=limits, owners={"r": "127.0.0.1"}) as running:
            talker = running.com_talker()
            for name in ("R", *(f"N{number}" for number in range(10))):
                assert talker.message(b"REGISTER %s 127.0.0.1;" % name.encode()) == b"OK;"
            assert talker.message(b"LISTEN R 1;") == b"OK;"
            assert talker.message(b"LISTEN N9 1;") == b"OK;"
            assert talker.message(b"LISTEN N0 1;") == b"Fail: Robot N0 not registered;"

    def test_words_have_a_length(self) -> None:
        """What is longer than any name is an incorrect message, and is stored nowhere."""
        with Running(Line()) as running:
            talker = running.com_talker()
            assert talker.message(b"REGISTER A 127.0.0.1;") == b"OK;"
            for text in (b"REGISTER %s 127.0.0.1;", b"LISTEN A %s;"):
                assert talker.message(text % (b"x" * 65)) == b"Fail: Incorrect Message;"
