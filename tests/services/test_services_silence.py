"""Machines that are switched off are noticed; clients that live and do not read are not ended."""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import Callable

import pytest
from far_machine import FarMachine
from services_harness import GREETING, Running, fill
from wireless_harness import POLL, Line
from wireless_harness import Running as Radio

from usarsim_server.base.logs import Log
from usarsim_server.services import listener
from usarsim_server.services.comserver import ComServerLimits
from usarsim_server.services.control import ControlLimits
from usarsim_server.services.listener import Listener, ListenerLimits
from usarsim_server.services.relay import LinkOptions, join
from usarsim_server.services.silence import GONE, PATIENCE, Silence, TcpInfo, ends_when_gone
from usarsim_server.sessions.outbox import OutboxLimits
from usarsim_server.testing import PATIENCE as HANGS
from usarsim_server.testing import eventually

SHORT = 0.5
"""s of silence that are too long here, instead of half a minute."""


def info_bytes(
    in_flight: int = 0, ack_age: int = 0, data_age: int = 1 << 31, repeat: int = 200_000
) -> bytes:
    """What Linux fills in (include/uapi/linux/tcp.h): eight bytes, then words of 32 bits."""
    words = [repeat, 40_000, 1448, 536, in_flight, 0, 0, 0, 0, 5, 0, data_age, ack_age]
    return struct.pack("=8B13I", *(1, 0, 0, 0, 0, 0, 0, 0), *words) + bytes(136)


class TestTcpInfo:
    def test_fields_are_found(self) -> None:
        """Segments in flight, the age of what came last in s, and the time between repetitions."""
        info = TcpInfo.parse(info_bytes(7, ack_age=31_500, data_age=40_000, repeat=51_200_000))
        assert info == TcpInfo(7, 31.5, 51.2)
        assert TcpInfo.parse(info_bytes(1, ack_age=9000, data_age=2000)) == TcpInfo(1, 2.0, 0.2)

    def test_kernels_that_tell_less_are_not_believed(self) -> None:
        """Half a structure says nothing."""
        assert TcpInfo.parse(info_bytes()[:59]) is None
        assert TcpInfo.parse(b"") is None

    def test_of_a_real_connection(self) -> None:
        """What the kernel says is read at the right places."""
        with (
            socket.create_server(("127.0.0.1", 0)) as listening,
            socket.create_connection(listening.getsockname()) as near,
            listening.accept()[0] as far,
        ):
            near.sendall(b"x")
            assert far.recv(1) == b"x"
            assert eventually(lambda: (info := TcpInfo.of(near)) is not None and not info.in_flight)
            info = TcpInfo.of(near)
            assert info is not None
            assert 0.0 <= info.age < HANGS
            assert 0.2 <= info.repeat <= 1.0
        assert TcpInfo.of(near) is None, "it is closed"


def judged(*looks: tuple[float, int, float, float]) -> list[bool]:
    """Verdicts of looks at time, with segments in flight, age and time between repetitions."""
    silence = Silence(30.0, 0.0)
    return [
        silence.too_long(TcpInfo(flying, age, repeat), now) for now, flying, age, repeat in looks
    ]


class TestSilence:
    def test_a_machine_that_is_switched_off(self) -> None:
        """Nothing is heard any more while bytes are in flight: the end after half a minute."""
        looks = [(float(now), 3, now - 1.0, 0.2 * 2 ** (now // 3)) for now in range(3, 40, 3)]
        assert judged((1.0, 0, 0.0, 0.2), *looks) == [False] * 11 + [True] * 3

    def test_bytes_after_a_long_silence_get_their_time(self) -> None:
        """The last acknowledgement of a connection that was quiet may be an hour old."""
        assert judged((3600.0, 0, 3600.0, 0.2), (3603.0, 1, 3603.0, 0.4), (3629.0, 1, 3629.0, 51.0))
        assert judged((3600.0, 0, 3600.0, 0.2), (3603.0, 1, 3603.0, 0.4)) == [False, False]
        assert judged((3600.0, 0, 3600.0, 0.2), (3631.0, 1, 3631.0, 51.0)) == [False, True]

    def test_a_full_window_has_nothing_in_flight(self) -> None:
        """Who does not read stays, however far apart the probes are."""
        assert not any(judged(*((float(now), 0, now, 0.2) for now in range(0, 600, 3))))

    def test_repetitions_that_are_answered(self) -> None:
        """Who drops what there is no room for is heard only when the kernel sends again."""
        at, gap, looks = 0.0, 0.2, []
        while gap < 60.0:
            looks += [(at + 1.0 + age, 9, age, 2.0 * gap) for age in range(0, int(2.0 * gap), 3)]
            at, gap = at + 2.0 * gap, 2.0 * gap
        assert max(age for _, _, age, _ in looks) > 90
        assert not any(judged(*looks))
        silent = [(at + 1.0 + age, 9, float(age), 102.4) for age in range(0, 150, 3)]
        assert judged(*looks, *silent)[-1], "until one of them is not"

    def test_one_acknowledgement_counts_once(self) -> None:
        """Ages come in steps of some ms, and times of repetitions grow: neither gives more time."""
        looks = [(float(n), 1, n - 0.99 - 0.01 * (n % 2), 0.2 * 2**n) for n in range(1, 33)]
        assert [verdict for verdict in judged(*looks) if verdict] == [True]


class FakeConnection:
    """A socket whose `TCP_INFO` a test writes."""

    def __init__(self, info: bytes = b"") -> None:
        self.info = info

    def getsockopt(self, level: int, option: int, size: int) -> bytes:
        assert (level, option) == (socket.IPPROTO_TCP, socket.TCP_INFO)
        return self.info[:size]


async def test_other_systems_are_not_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the kernel tells nothing, nothing ends."""
    monkeypatch.setattr("usarsim_server.services.silence._KNOWN", False)
    gone = FakeConnection(info_bytes(1, ack_age=1 << 30))
    assert TcpInfo.of(gone) is None  # type: ignore[arg-type]
    with ends_when_gone(gone, Log("test"), 0.001):  # type: ignore[arg-type]
        await asyncio.sleep(0.02)


def test_dead_machines_have_half_a_minute_on_every_port() -> None:
    """Keepalive, for connections on which nothing is in flight, takes as long as the watch."""
    with socket.socket() as one:
        listener.tune(one)
        names = ("TCP_KEEPIDLE", "TCP_KEEPINTVL", "TCP_KEEPCNT")
        idle, between, count = (
            one.getsockopt(socket.IPPROTO_TCP, getattr(socket, name)) for name in names
        )
        assert idle + between * count == PATIENCE == 30.0
    assert ListenerLimits().silence == LinkOptions().silence == PATIENCE


class TestOfMachines:
    @pytest.fixture(params=["switched off", "unplugged"])
    def leave(self, request: pytest.FixtureRequest, far_machine: FarMachine) -> Callable[[], None]:
        """Makes the machine go without a goodbye."""
        off = request.param == "switched off"
        return far_machine.switch_off if off else far_machine.unplug

    def test_its_robot_leaves_the_world(
        self,
        far_machine: FarMachine,
        leave: Callable[[], None],
        caplog: pytest.LogCaptureFixture,
    ) -> None:
        """A controller is gone while status lines are on their way to it: its session ends."""
        with Running(ControlLimits(silence=SHORT), host=far_machine.here) as server:
            client = far_machine.connect(server.endpoint.port)
            server.clients.append(client)
            assert eventually(lambda: len(server.sessions) == 1)
            [session] = server.sessions
            assert client.recv(len(GREETING), socket.MSG_WAITALL) == GREETING
            leave()
            session.outbox.put_stream(b"STA {Time 1.2}\r\n")
            assert eventually(lambda: session.closes == 1)
        assert any(GONE in message for message in caplog.messages)

    async def test_any_service_ends(
        self,
        far_machine: FarMachine,
        leave: Callable[[], None],
    ) -> None:
        """Even one that waits until its client takes more: it fills what the kernel holds."""
        ended = asyncio.Event()

        async def pictures(client: socket.socket, peer: str) -> None:
            try:
                while True:
                    await asyncio.get_running_loop().sock_sendall(client, bytes(100_000))
            finally:
                ended.set()

        service = Listener(
            "test", far_machine.here, 0, pictures, limits=ListenerLimits(silence=SHORT)
        )
        endpoint = await service.start()
        with await asyncio.to_thread(far_machine.connect, endpoint.port) as client:
            assert await asyncio.to_thread(client.recv, 1000)
            reads = asyncio.create_task(asyncio.to_thread(self._read, client, leave))
            async with asyncio.timeout(HANGS):
                await ended.wait()
            await reads
        await service.stop()

    @staticmethod
    def _read(client: socket.socket, leave: Callable[[], None]) -> None:
        """Read a while, so that something is in flight when the machine goes."""
        for _ in range(50):
            client.recv(65536)
        leave()

    async def test_a_link_by_radio_ends(
        self,
        far_machine: FarMachine,
        leave: Callable[[], None],
    ) -> None:
        """On 50000: a robot's machine is gone while the other one sends to it."""
        with (
            socket.create_server((far_machine.here, 0)) as listening,
            far_machine.connect(listening.getsockname()[1]) as robot,
            listening.accept()[0] as there,
        ):
            here, other = socket.socketpair()
            there.setblocking(False)
            here.setblocking(False)
            options = LinkOptions(silence=SHORT)
            link = asyncio.create_task(join(here, there, options, "A B", lambda *_: None))
            other.sendall(b"over")
            assert await asyncio.to_thread(robot.recv, 4) == b"over"
            leave()
            other.sendall(b"and out")
            await asyncio.wait({link}, timeout=HANGS)
            assert link.cancelled()
            here.close()
            other.close()

    def test_a_link_of_the_older_wireless_ends(
        self,
        far_machine: FarMachine,
        leave: Callable[[], None],
    ) -> None:
        """On 5874, where the server dials both robots."""
        limits = ComServerLimits(poll=POLL, silence=SHORT)
        with far_machine.inside():
            theirs = socket.create_server((far_machine.address, 0))
        with (
            Radio(Line(A=0, B=1), com_limits=limits) as radio,
            socket.create_server(("127.0.0.1", 0)) as ours,
            theirs,
        ):
            a, b = (one.getsockname()[1] for one in (ours, theirs))
            talker = radio.com_talker()
            for message in (
                "REGISTER A 127.0.0.1;",
                f"REGISTER B {far_machine.address};",
                f"LISTEN B {b};",
                f"OPEN A {a} B {b};",
            ):
                assert talker.message(message.encode()) == b"OK;"
            with ours.accept()[0] as mine, theirs.accept()[0] as robot:
                mine.settimeout(HANGS)
                mine.sendall(b"SEND 4 over;")
                assert robot.recv(1)
                leave()
                mine.sendall(b"SEND 4 over;")
                assert mine.recv(1) == b"", "the link is over"


class TestOfClientsThatDoNotRead:
    def test_they_stay(
        self, control: Callable[..., Running], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """A program that halts in a debugger keeps its robot, and reads on afterwards."""
        accepted: list[socket.socket] = []
        tune = listener.tune
        monkeypatch.setattr(listener, "tune", lambda one: (tune(one), accepted.append(one)))
        outbox = OutboxLimits(stream_bytes=64 * 1024)
        server = control(
            ControlLimits(silence=0.1, outbox=outbox, receive_buffer=8192, send_buffer=8192)
        )
        client, session = server.pair(receive_buffer=4096)
        fill(session, 2000)
        [one] = accepted

        def silent() -> bool:
            """Whether the kernel's probes have become so rare that only the full window counts."""
            info = TcpInfo.of(one)
            assert info is not None, "the connection was ended"
            return info.in_flight == 0 and info.age > 10 * 0.1

        assert eventually(silent)
        assert session.closes == 0
        session.outbox.put_reply(b"CONF {Name last}\r\n")
        while client.line() != b"CONF {Name last}\r\n":
            pass
        assert session.closes == 0
