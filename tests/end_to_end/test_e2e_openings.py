"""Text ports close connections that begin with HTTP or TLS, and obey nothing in them."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from usarsim_server.protocol.opening import Opening
from usarsim_server.testing import PATIENCE, ScriptedClient, ServerProcess

INIT = b"INIT {ClassName USARBot.P2AT} {Name Planted} {Location 1,1,-0.3}\r\n"
FORM = b"POST / HTTP/1.1\r\nHost: 127.0.0.1:3000\r\nContent-Type: text/plain\r\n\r\n"
FOREIGN = {
    "a form of a page": (FORM, "HTTP"),
    "a request of HTTP/1.0": (b"get /x HTTP/1.0\n", "HTTP"),
    "a very long address": (b"GET /" + b"a" * 300_000 + b" HTTP/1.1\r\n", "HTTP"),
    "an empty line before it": (b"\r\n\r\nGET / HTTP/1.1\r\n", "HTTP"),
    "the preface of HTTP/2": (b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", "HTTP"),
    "a TLS hello": (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", "TLS"),
}
LINES = (
    b"TRACE {On true}\r\n", b"GETCONF {Type Sensor}\r\n", b"GETPOS {Robot R1}\r\n", b"\r\n", b"OK",
    b"GETSTARTPOSES\r\n", b"INIT {ClassName USARBot.P2AT} {Name HTTP/1.1}\r\n",
    b"DRIVE {Left 1.0} {Right 1.0}\r\nGET / HTTP/1.1\r\n", b"REGISTER R1 127.0.0.1;", b"\x16\r\n",
)  # fmt: skip
PORTS = ("control", "groundtruth", "wireless", "comserver", "truth")


@pytest.mark.parametrize("size", [1, 7, 1 << 20])
@pytest.mark.parametrize("opening", list(FOREIGN))
def test_first_lines_of_other_protocols_are_known(opening: str, size: int) -> None:
    """In pieces of any size."""
    data, protocol = FOREIGN[opening]
    first = Opening()
    said = [first.foreign(data[start : start + size]) for start in range(0, len(data), size)]
    assert next(filter(None, said), "") == protocol


@pytest.mark.parametrize("line", LINES)
def test_lines_of_the_protocol_are_left_alone(line: bytes) -> None:
    """Also such as hold a word of HTTP, or come after the first one."""
    opening = Opening()
    assert not any(opening.foreign(bytes([byte])) for byte in line)


@pytest.fixture(scope="module")
def server() -> Iterator[ServerProcess]:
    """A server with all text ports."""
    with ServerProcess("--world", "empty", *(f"--{one}-port=0" for one in PORTS[1:])) as process:
        yield process


@pytest.mark.parametrize("port", PORTS)
def test_ports_close_and_obey_nothing(server: ServerProcess, port: str) -> None:
    """A form that holds commands brings no robot; the connection is closed."""
    for data, _ in FOREIGN.values():
        with socket.create_connection(("127.0.0.1", server.ports[port]), PATIENCE) as client:
            client.sendall(data)
            client.sendall(INIT)
            try:
                while client.recv(65536):
                    pass
            except ConnectionResetError:
                pass
    with ScriptedClient(server.ports["truth"]) as asks:
        asks.send("")
        assert b"Planted" not in asks.socket.recv(65536)
    with ScriptedClient(server.ports["control"]) as robot:
        robot.send("GETSTARTPOSES")
        assert robot.wait_for("NFO {StartPoses")
