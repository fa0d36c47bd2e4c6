"""Roads between robots: DNS, the relay, REVERSEDNS (side channels reference 4.2, 4.3)."""

from __future__ import annotations

import re

from usarsim_conformance import side_lines
from usarsim_conformance.case import Case
from usarsim_conformance.side_checks import checks_of
from usarsim_conformance.side_lines import Radio
from usarsim_conformance.verdicts import Severity
from usarsim_conformance.wire import Wire

wireless = checks_of("wireless")

_EVERY_BYTE = bytes(range(256)) * 16


async def _received(case: Case, wire: Wire, data: bytes, way: str) -> None:
    found = await wire.read_exactly(len(data), side_lines.CARRIES)
    case.expect(found == data, f"{len(data)} bytes were changed {way}")


@wireless("dns.form", "DNS tells a port", "4.2")
async def form(case: Case) -> None:
    """`DNS {Robot other}` is answered by `DNSREPLY {Robot other} {Port p}`."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        line = await one.client.ask(f"DNS {{Robot {other.name}}}")
        pattern = rf"DNSREPLY \{{Robot {other.name}\}} \{{Port \d+\}}"
        case.expect(re.fullmatch(pattern, line), f"another reply: {line!r}")


@wireless("dns.stable", "A pair keeps its port", "11.72, 4.3")
async def stable(case: Case) -> None:
    """Repeated queries of a pair tell the same port; the other direction has another."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        ports = [await one.road(other) for _ in range(3)]
        case.expect(len(set(ports)) == 1, f"three queries tell {ports}")
        back = await other.road(one)
        case.expect(back != ports[0], f"both directions have port {back}")


@wireless("dns.first-port", "Without a port the first one is meant", "4.3")
async def first_port(case: Case) -> None:
    """DNS without a port leads to the first one that the other has registered."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        plain = await one.road(other)
        named = await one.road(other, f" {{Port {other.port}}}")
        case.expect(plain == named, f"port {plain} without, {named} with the port named")


@wireless("dns.nobody", "DNS of nobody", "4.2")
async def nobody(case: Case) -> None:
    """For an unknown robot, and for oneself, the port is -1 and the error NoSuchRobot."""
    async with await Radio.make(case) as radio:
        for name in ("Nobody?", radio.name):
            await radio.client.expect(
                f"DNS {{Robot {name}}}",
                f"DNSREPLY {{Robot {name}}} {{Port -1}} {{Error NoSuchRobot}}",
            )


@wireless("dns.wrong-port", "DNS of a port that nobody listens on", "4.2")
async def wrong_port(case: Case) -> None:
    """A port that the other has not registered gets RobotDoesNotListenOnThisPort."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        await one.client.expect(
            f"DNS {{Robot {other.name}}} {{Port 9}}",
            f"DNSREPLY {{Robot {other.name}}} {{Port -1}} {{Error RobotDoesNotListenOnThisPort}}",
        )


@wireless("dns.no-number", "Ports are numbers", "4.2")
async def no_number(case: Case) -> None:
    """A port that is no integer gets `Port.Must.Be.Integer`, from DNS and REVERSEDNS."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        for text in (f"DNS {{Robot {other.name}}} {{Port x}}", "REVERSEDNS {Port x}"):
            await one.client.expect(text, "ERROR {Reason Port.Must.Be.Integer}")


@wireless("reversedns.owner", "REVERSEDNS names the caller", "11.74, 4.2")
async def owner(case: Case) -> None:
    """The port that an accepted connection comes from leads to the robot behind it."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        _, guest = await one.call(other)
        port = guest.peer_port
        await other.client.expect(
            f"REVERSEDNS {{Port {port}}}", f"REVERSEDNSREPLY {{Port {port}}} {{Robot {one.name}}}"
        )


@wireless("reversedns.unknown", "REVERSEDNS of a strange port", "4.2")
async def unknown(case: Case) -> None:
    """A port that no relayed connection comes from gets UnknownOrIllegalPort."""
    async with await Radio.make(case) as radio:
        await radio.client.expect(
            "REVERSEDNS {Port 9}", "REVERSEDNSREPLY {Port 9} {Error UnknownOrIllegalPort}"
        )


@wireless("relay.there", "Bytes reach the other robot", "11.73, 4.3")
async def there(case: Case) -> None:
    """Bytes sent to the port of DNS reach the port of the other's INIT unchanged: all 256 values,
    zero bytes and line ends included."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        wire, guest = await one.call(other)
        await wire.send(_EVERY_BYTE)
        data = await guest.read(len(_EVERY_BYTE))
        case.expect(
            data == _EVERY_BYTE, f"{len(data)} of {len(_EVERY_BYTE)} bytes, or changed ones"
        )


@wireless("relay.back", "Bytes come back", "11.73, 4.3")
async def back(case: Case) -> None:
    """The other robot answers on the same connection, and its bytes arrive unchanged."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        wire, guest = await one.call(other)
        guest.writer.write(_EVERY_BYTE)
        await guest.writer.drain()
        await _received(case, wire, _EVERY_BYTE, "on the way back")


@wireless("relay.much", "Much data passes", "4.3")
async def much(case: Case) -> None:
    """A megabyte arrives whole and in order."""
    data = b"".join(number.to_bytes(4) for number in range(262_144))
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        wire, guest = await one.call(other)
        await wire.send(data)
        found = await guest.read(len(data))
        case.expect(found == data, f"{len(found)} of {len(data)} bytes arrived, or out of order")


@wireless("relay.hangup", "The end of one side ends the other", "4.3")
async def hangup(case: Case) -> None:
    """When one robot hangs up, the other's connection ends too, behind the last bytes; in either
    direction."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        wire, guest = await one.call(other)
        await wire.send(b"last words")
        wire.close()
        case.expect(await guest.read(10) == b"last words", "the last words were lost")
        case.expect(await guest.hung_up(), "the other end stays open after a hangup")
        wire, guest = await one.call(other)
        guest.writer.close()
        case.expect(
            await wire.hung_up(side_lines.LEAVES), "the caller's end stays open after a hangup"
        )


@wireless("relay.half-close", "Half-closed connections still carry", "4.3", Severity.SHOULD)
async def half_close(case: Case) -> None:
    """What was sent before an end of file arrives in full."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        wire, guest = await one.call(other)
        await wire.send(_EVERY_BYTE * 8)
        wire.half_close()
        found = await guest.read(len(_EVERY_BYTE) * 8 + 1)
        case.expect(found == _EVERY_BYTE * 8, f"{len(found)} of {len(_EVERY_BYTE) * 8} bytes came")


@wireless("relay.several", "Several connections of a pair", "4.3", Severity.SHOULD)
async def several(case: Case) -> None:
    """A pair may have several connections at a time; their bytes are not mixed up."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        pairs = [await one.call(other) for _ in range(3)]
        for number, (wire, _) in enumerate(pairs):
            await wire.send(bytes([number]) * 1000)
        for number, (_, guest) in enumerate(pairs):
            data = await guest.read(1000)
            case.expect(data == bytes([number]) * 1000, f"connection {number + 1} got other bytes")


@wireless("relay.refused", "The other does not listen", "4.3")
async def refused(case: Case) -> None:
    """If the other robot refuses the connection, the caller is accepted and then hung up."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        port = await one.road(other)
        other.deaf()
        wire = await one.dial(port)
        case.expect(await wire.hung_up(side_lines.LEAVES), "the caller is left hanging")


@wireless("relay.leaver", "A road closes with its robot", "4.4")
async def leaver(case: Case) -> None:
    """When a robot leaves the simulator, its relayed connections are closed."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        wire, guest = await one.call(other)
        other.robot.close()
        case.expect(
            await wire.hung_up(side_lines.LEAVES),
            "the caller's end stays open when the other has left",
        )
        case.expect(await guest.hung_up(), "the end of the robot that left stays open")
