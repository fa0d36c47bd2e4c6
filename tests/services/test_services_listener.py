"""The listener: clear errors when it cannot bind, and an accept loop that nothing ends."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import socket
import time

import pytest
from held_ports import held_port

from usarsim_server.base.errors import ServiceError
from usarsim_server.services import listener as module
from usarsim_server.services.listener import Endpoint, Listener, ListenerLimits, format_address
from usarsim_server.testing import PATIENCE, eventually


async def echo(client: socket.socket, peer: str) -> None:
    """Send back what comes until the client closes."""
    loop = asyncio.get_running_loop()
    while data := await loop.sock_recv(client, 4096):
        await loop.sock_sendall(client, data)


@contextlib.asynccontextmanager
async def listening(handler=echo, port=0, **options):
    """A started listener and its endpoint; stopped afterwards."""
    listener = Listener("test", "127.0.0.1", port, handler, **options)
    endpoint = await listener.start()
    try:
        yield listener, endpoint
    finally:
        await listener.stop()


@contextlib.asynccontextmanager
async def connected(endpoint):
    """A client's reader and writer."""
    reader, writer = await asyncio.open_connection(endpoint.host, endpoint.port)
    try:
        yield reader, writer
    finally:
        writer.close()


async def echoes(endpoint) -> bool:
    """Whether a new client is served."""
    async with asyncio.timeout(PATIENCE), connected(endpoint) as (reader, writer):
        writer.write(b"ping\n")
        return await reader.readline() == b"ping\n"


async def soon(condition) -> bool:
    """Whether the condition comes true."""
    return await asyncio.to_thread(eventually, condition)


# Binding


async def test_port_zero_takes_a_free_port_and_reports_it() -> None:
    """The endpoint names the port that was really bound."""
    async with listening() as (_, endpoint):
        assert endpoint.port > 0
        assert str(endpoint) == f"test=127.0.0.1:{endpoint.port}"
        assert await echoes(endpoint)


async def test_busy_port_is_one_clear_error_with_the_cure() -> None:
    """The message names the port, the host and the option that changes it."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(ServiceError) as caught:
            async with listening(port=port, option="--image-port"):
                pass
        message = str(caught.value)
        assert f"port {port} is already in use on 127.0.0.1" in message
        assert "--image-port N" in message
        assert "\n" not in message


async def test_port_is_free_again_after_stop() -> None:
    """Stopping releases the port at once, connections that lingered notwithstanding."""
    with held_port() as port:
        for _ in range(2):
            async with listening(port=port) as (_, endpoint):
                assert endpoint.port == port
                assert await echoes(endpoint)


@pytest.mark.parametrize(
    ("host", "part"),
    [
        ("192.0.2.1", "is not an address of this machine"),  # TEST-NET-1, never ours
        ("no-such-host.invalid", "is unknown"),
        ("a" * 70 + ".invalid", "is unknown"),
        ("\u2024", "is unknown"),
    ],
)
async def test_host_that_is_not_ours_is_one_clear_error(host: str, part: str) -> None:
    """A foreign address and an unknown name are explained, with an address that works."""
    with pytest.raises(ServiceError, match=part) as caught:
        await Listener("test", host, 0, echo).start()
    assert "0.0.0.0" in str(caught.value)


@pytest.mark.parametrize(
    ("number", "part"),
    [(errno.EACCES, "no permission"), (errno.EPROTONOSUPPORT, "cannot listen on 127.0.0.1:81")],
)
async def test_refused_binding_is_one_clear_error(monkeypatch, number: int, part: str) -> None:
    """A privileged port says so; any other failure names the address and the reason."""

    def refuse(self, address):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(socket.socket, "bind", refuse)

    with pytest.raises(ServiceError, match=part):
        await Listener("test", "127.0.0.1", 81, echo).start()


async def test_host_name_is_bound_on_ipv4() -> None:
    """The legacy clients speak IPv4: `localhost` is 127.0.0.1 even where ::1 comes first."""
    listener = Listener("test", "localhost", 0, echo)
    loop = asyncio.get_running_loop()
    found = await loop.getaddrinfo("127.0.0.1", 0, type=socket.SOCK_STREAM)
    six = (socket.AF_INET6, socket.SOCK_STREAM, 6, "", ("::1", 0, 0, 0))

    async def both(*arguments, **options):
        return [six, *found]

    loop.getaddrinfo = both  # type: ignore[method-assign]
    endpoint = await listener.start()
    await listener.stop()
    assert endpoint.host == "127.0.0.1"


async def test_second_start_is_a_mistake_of_the_program() -> None:
    """A listener that listens refuses to start again."""
    async with listening() as (listener, _):
        with pytest.raises(RuntimeError, match="listens already"):
            await listener.start()


def test_stop_without_start_does_nothing() -> None:
    """A service that never started can be stopped."""
    asyncio.run(Listener("test", "127.0.0.1", 0, echo).stop())


@pytest.mark.parametrize(
    ("host", "text", "loopback"),
    [
        ("127.0.0.1", "127.0.0.1:80", True),
        ("127.8.0.1", "127.8.0.1:80", True),
        ("::1", "[::1]:80", True),
        ("0.0.0.0", "0.0.0.0:80", False),
        ("fe80::1%eth0", "[fe80::1%eth0]:80", False),
    ],
)
def test_endpoint_text_and_reach(host: str, text: str, loopback: bool) -> None:
    """An IPv6 host stands in brackets; only loopback addresses are private to the machine."""
    endpoint = Endpoint("control", host, 80)
    assert endpoint.address == text == format_address(host, 80)
    assert endpoint.loopback is loopback


# Accepting


class ScriptedAccept:
    """Raises errors in place of `loop.sock_accept`, then hands over to the real one."""

    def __init__(self, *numbers: int) -> None:
        self.loop = asyncio.get_running_loop()
        self.numbers = list(numbers)
        self.times: list[float] = []
        self.real = self.loop.sock_accept
        self.loop.sock_accept = self  # type: ignore[assignment, method-assign]

    async def __call__(self, listening: socket.socket):
        self.times.append(time.monotonic())
        if self.numbers:
            number = self.numbers.pop(0)
            raise OSError(number, os.strerror(number))
        return await self.real(listening)


@pytest.mark.parametrize("number", [errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENOBUFS])
async def test_lack_of_resources_pauses_accepting_and_is_said_once(caplog, number: int) -> None:
    """Out of descriptors: one warning, a pause without spinning, then clients are served again."""
    caplog.set_level("INFO", "usarsim")

    accept = ScriptedAccept(number, number, number)
    async with listening() as (_, endpoint):
        assert await echoes(endpoint)
    pauses = [b - a for a, b in zip(accept.times[:3], accept.times[1:4], strict=True)]
    assert all(pause > 0.09 for pause in pauses)
    warnings = [record for record in caplog.records if record.levelname == "WARNING"]
    assert len(warnings) == 1
    assert "ulimit -n" in warnings[0].message
    assert caplog.messages.count("accepting connections again") == 1


@pytest.mark.parametrize("number", [errno.ECONNABORTED, errno.EPROTO, errno.ENETDOWN])
async def test_connection_lost_on_arrival_is_skipped(caplog, monkeypatch, number: int) -> None:
    """accept(2): an error of the arriving connection itself does not delay the next one."""
    monkeypatch.setattr(module, "RESOURCE_PAUSE", 10 * PATIENCE)
    monkeypatch.setattr(module, "_FAILURE_PAUSE", 10 * PATIENCE)

    ScriptedAccept(number, number)
    async with listening() as (_, endpoint):
        assert await echoes(endpoint)
    assert caplog.records == []


async def test_unforeseen_accept_error_is_reported_and_tried_again(caplog, monkeypatch) -> None:
    """Any other error is logged and does not end the service."""
    monkeypatch.setattr(module, "_FAILURE_PAUSE", 0.05)

    ScriptedAccept(errno.EIO, errno.EIO)
    async with listening() as (_, endpoint):
        assert await echoes(endpoint)
    assert [record.levelname for record in caplog.records] == ["ERROR"]


async def test_limit_counts_connections_that_are_open() -> None:
    """Beyond the limit a client is closed at once; a place that comes free is given on."""
    limits = ListenerLimits(max_connections=2)
    async with listening(limits=limits) as (listener, endpoint):
        async with connected(endpoint), connected(endpoint):
            assert await soon(lambda: listener.connections == 2)
            async with connected(endpoint) as (reader, _):
                assert await reader.read() == b""
            assert listener.connections == 2
        assert await soon(lambda: listener.connections == 0)
        assert await echoes(endpoint)


async def test_peer_is_the_address_of_the_client() -> None:
    """The handler is told `host:port` of its client."""
    peers = []

    async def handler(client: socket.socket, peer: str) -> None:
        peers.append(peer)

    async with listening(handler) as (_, endpoint), connected(endpoint) as (reader, writer):
        assert await reader.read() == b""
        host, port = writer.get_extra_info("sockname")
        assert peers == [f"{host}:{port}"]


# Ending


@pytest.mark.parametrize(
    "failure", [ValueError("a defect"), ExceptionGroup("group", [ValueError("a defect")])]
)
async def test_defect_of_a_handler_is_logged_and_ends_its_connection_only(caplog, failure) -> None:
    """An unexpected exception closes that client with a traceback; others go on."""
    doomed = True

    async def handler(client: socket.socket, peer: str) -> None:
        if doomed:
            raise failure
        await echo(client, peer)

    async with listening(handler) as (_, endpoint):
        async with connected(endpoint) as (reader, _):
            assert await reader.read() == b""
        doomed = False
        assert await echoes(endpoint)
    assert [record.levelname for record in caplog.records] == ["ERROR"]
    assert caplog.records[0].exc_info is not None


async def test_client_that_vanishes_is_no_defect(caplog) -> None:
    """An OSError of the socket is ordinary: no traceback, nothing above debug level."""
    caplog.set_level("INFO", "usarsim")

    async def handler(client: socket.socket, peer: str) -> None:
        raise ConnectionResetError(errno.ECONNRESET, "reset")

    async with listening(handler) as (_, endpoint), connected(endpoint) as (reader, _):
        assert await reader.read() == b""
    assert all(record.levelname == "INFO" for record in caplog.records)


async def test_stop_ends_handlers_and_closes_their_sockets() -> None:
    """Stop cancels conversations; their cleanup runs before it returns, clients see the end."""
    cleaned = []

    async def handler(client: socket.socket, peer: str) -> None:
        try:
            await asyncio.sleep(10 * PATIENCE)
        finally:
            await asyncio.sleep(0.01)
            cleaned.append(peer)

    async with (
        listening(handler) as (listener, endpoint),
        connected(endpoint) as (one, _),
        connected(endpoint) as (two, _),
    ):
        assert await soon(lambda: listener.connections == 2)
        await listener.stop()
        assert len(cleaned) == 2
        assert listener.connections == 0
        assert [await one.read(), await two.read()] == [b"", b""]


async def test_client_accepted_just_before_stop_is_closed_too() -> None:
    """A conversation that is cancelled before its first step leaves no open socket behind."""
    accepted = []

    async with listening() as (listener, endpoint):
        admit = listener._admit

        def admit_and_stop(client, peer, clients) -> None:
            accepted.append(client)
            admit(client, peer, clients)
            listener._task.cancel()

        listener._admit = admit_and_stop
        async with connected(endpoint) as (reader, _):
            assert await reader.read() == b""
        assert listener.connections == 0
    assert [client.fileno() for client in accepted] == [-1]


async def test_handler_that_does_not_end_is_abandoned_in_time(caplog, monkeypatch) -> None:
    """Stop returns after its time limit, with a log line, even if a handler ignores it."""
    monkeypatch.setattr(module, "_STOP_TIMEOUT", 0.1)
    release = asyncio.Event()

    async def stubborn(client: socket.socket, peer: str) -> None:
        while not release.is_set():
            with contextlib.suppress(asyncio.CancelledError):
                await release.wait()

    async with listening(stubborn) as (listener, endpoint), connected(endpoint):
        assert await soon(lambda: listener.connections == 1)
        task = listener._task
        await listener.stop()
        release.set()
        await asyncio.wait({task})
    assert "connections did not end in time" in caplog.messages
