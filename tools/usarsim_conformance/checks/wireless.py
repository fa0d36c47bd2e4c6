"""The wireless simulation: its dialogue, and roads between robots by DNS, relay and REVERSEDNS
(side channels reference 4.1 to 4.3)."""

from __future__ import annotations

import asyncio
import re

from usarsim_conformance import side_lines
from usarsim_conformance.case import Case
from usarsim_conformance.lines import number
from usarsim_conformance.registry import Severity, checks_of
from usarsim_conformance.side_lines import LineClient, Radio
from usarsim_conformance.wire import Wire

wireless = checks_of("wireless")

_QUIET = 0.5
_INIT_FIRST = "ERROR {Reason Must.Use.INIT.Method.First}"
_UNKNOWN = "ERROR {Reason Method.Unknown.Or.Can.INIT.only.once}"


async def _client(case: Case) -> LineClient:
    return await LineClient.open(case, "wireless")


@wireless("connect.silent", "Says nothing before it is asked", "4.2")
async def silent(case: Case) -> None:
    """The robot speaks first."""
    await (await _client(case)).silent(1.0, "connecting")


@wireless("init.ok", "INIT registers a robot", "11.68, 4.2")
async def ok(case: Case) -> None:
    """`INIT {Robot n} {Port p}` is answered by `INITREPLY {Status OK}`."""
    async with await Radio.make(case, register=False) as radio:
        await radio.register()
        await radio.client.silent(_QUIET, "one line for one request")


@wireless("init.several-ports", "INIT takes several ports", "4.2")
async def several_ports(case: Case) -> None:
    """Port may list several ports with commas between."""
    async with await Radio.make(case, register=False) as radio:
        await radio.client.expect(
            f"INIT {{Robot {radio.name}}} {{Port {radio.port},2323}}", "INITREPLY {Status OK}"
        )


@wireless("init.first", "INIT must come first", "11.69, 4.2")
async def first(case: Case) -> None:
    """Any other verb before INIT gets `Must.Use.INIT.Method.First`."""
    client = await _client(case)
    for text in ("GETSS {Robot A}", "DNS {Robot A}", "REVERSEDNS {Port 5}", "HELLO {Robot A}"):
        await client.expect(text, _INIT_FIRST)


@wireless("init.once", "INIT can be used once only", "4.2")
async def once(case: Case) -> None:
    """A second INIT after a successful one is refused."""
    async with await Radio.make(case) as radio:
        await radio.client.expect(f"INIT {{Robot {radio.name}x}} {{Port 5}}", _UNKNOWN)


@wireless("init.duplicate", "A name is taken once", "11.70, 4.2")
async def duplicate(case: Case) -> None:
    """A name that is registered gets `Robot.Alread.Exists`, in the original's spelling, and a
    retry with another name on the same connection succeeds."""
    async with await Radio.make(case) as one, await Radio.make(case, register=False) as other:
        await other.client.expect(
            f"INIT {{Robot {one.name}}} {{Port 5}}", "ERROR {Reason Robot.Alread.Exists}"
        )
        await other.register()


@wireless("init.bad-ports", "Ports must be numbers", "4.2")
async def bad_ports(case: Case) -> None:
    """A port that is no integer gets `Ports.List.Must.Be.Integer`; a retry succeeds."""
    async with await Radio.make(case, register=False) as radio:
        for ports in ("http", "5000,x"):
            await radio.client.expect(
                f"INIT {{Robot {radio.name}}} {{Port {ports}}}",
                "ERROR {Reason Ports.List.Must.Be.Integer}",
            )
        await radio.register()


@wireless("init.no-name", "A robot needs a name", "4.2")
async def no_name(case: Case) -> None:
    """INIT without a name gets `Robot.Name.Must.Not.Be.Empty`."""
    client = await _client(case)
    await client.expect("INIT {Port 3333}", "ERROR {Reason Robot.Name.Must.Not.Be.Empty}")


@wireless("init.free-again", "A name is free when its connection ends", "4.2")
async def free_again(case: Case) -> None:
    """Closing the control connection unregisters; another can take the name soon after."""
    async with await Radio.make(case) as radio:
        radio.client.wire.close()

        async def free() -> bool:
            radio.client.wire.close()
            radio.client = await _client(case)
            text = f"INIT {{Robot {radio.name}}} {{Port {radio.port}}}"
            return await radio.client.ask(text) == "INITREPLY {Status OK}"

        case.expect(
            await case.soon(free, 3.0),
            f"the name {radio.name} is not free 3 s after its connection ended",
        )


@wireless("request.unknown", "Unknown verbs are refused", "4.2")
async def unknown(case: Case) -> None:
    """After INIT an unknown verb gets `Method.Unknown.Or.Can.INIT.only.once`."""
    async with await Radio.make(case) as radio:
        await radio.client.expect("CLOSE {Robot A}", _UNKNOWN)


@wireless("request.case", "Verbs are case-sensitive", "4.1", Severity.SHOULD)
async def verb_case(case: Case) -> None:
    """A verb in lower case is unknown."""
    await (await _client(case)).expect("init {Robot A} {Port 5}", _INIT_FIRST)


@wireless("request.pipelined", "Every request gets one reply", "4.1")
async def pipelined(case: Case) -> None:
    """Requests that come together are answered one by one, in order."""
    async with await Radio.make(case) as radio:
        client = radio.client
        await client.wire.send(b"GETSS {Robot A?}\r\nDNS {Robot B?}\r\nREVERSEDNS {Port 5}\r\n")
        heads = [(await client.line()).partition(" ")[0] for _ in range(3)]
        case.expect(
            heads == ["SS", "DNSREPLY", "REVERSEDNSREPLY"],
            f"three requests in one packet are answered by {heads}, not by SS, DNSREPLY, "
            "REVERSEDNSREPLY",
        )
        await client.silent(_QUIET, "three lines for three requests")


@wireless("request.split", "Requests may come in pieces", "4.1")
async def split(case: Case) -> None:
    """A request that comes in pieces is answered once, when its end is there."""
    client = await _client(case)
    for part in (b"GETSS {Rob", b"ot A}\r", b"\n"):
        await client.wire.send(part)
        await asyncio.sleep(0.15)
    answer = await client.line()
    case.expect(
        answer == _INIT_FIRST,
        f"a request in pieces is answered by {answer!r}, not by {_INIT_FIRST!r}",
    )
    await client.silent(_QUIET, "one line for one request")


@wireless("request.crashers", "Survives what the original did not", "11.77, 4.6")
async def crashers(case: Case) -> None:
    """An empty line, verbs without a blank behind them, and groups that never close do no harm."""
    async with await Radio.make(case, register=False) as radio:
        client = radio.client
        await client.wire.send(b"\r\nGETSS\r\nDNS\r\n{}\r\n}{\r\nINIT\r\nINIT {Robot\r\n\0\xff\r\n")
        await client.wire.silence(_QUIET)
        await radio.register()


@wireless("request.no-arguments", "Missing arguments get one line", "11.77, 4.2")
async def no_arguments(case: Case) -> None:
    """After INIT a verb without its argument gets exactly one line."""
    async with await Radio.make(case) as radio:
        for text in ("GETSS", "DNS", "REVERSEDNS", "GETSS {}", "DNS {Port 5}"):
            await radio.client.ask(text)
            await radio.client.silent(0.2, f"one line for {text!r}")


@wireless("request.long-line", "Survives a line without end", "4.1", Severity.SHOULD)
async def long_line(case: Case) -> None:
    """A megabyte without a line end neither blocks other connections nor ends the server."""
    endless, other = await _client(case), await _client(case)
    await endless.wire.send(b"A" * 1_000_000)
    await other.expect("GETSS {Robot A}", _INIT_FIRST)


@wireless("request.slow-reader", "Who does not read stops nobody", "4.1")
async def slow_reader(case: Case) -> None:
    """While one client asks and never reads, others are answered."""
    stalled, other = await _client(case), await _client(case)
    await stalled.wire.send(b"GETSS {Robot A}\r\n" * 5000)
    for _ in range(3):
        await other.expect("GETSS {Robot A}", _INIT_FIRST)


# Signal strength.


async def _strength(case: Case, one: Radio, other: Radio) -> str:
    line = await one.client.ask(f"GETSS {{Robot {other.name}}}")
    found = re.fullmatch(
        rf"SS \{{Robot {re.escape(other.name)}\}} \{{Strength ([^{{}} ]+)\}}", line
    )
    case.expect(found, f"Strength is not a plain number: {line!r}")
    assert found is not None
    return found[1]


@wireless("getss.known", "The strength of another robot", "11.71, 4.2")
async def known(case: Case) -> None:
    """Between robots of the simulator the strength is a number of dBm, not above zero."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        value = number(await _strength(case, one, other))
        case.expect(-400.0 < value <= 0.0, f"Strength is {value}, not above -400 and at most 0 dBm")


@wireless("getss.digits", "Six significant digits", "4.2", Severity.SHOULD)
async def digits(case: Case) -> None:
    """A strength has at most six significant digits and no exponent."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        text = await _strength(case, one, other)
        count = len(re.sub(r"\D", "", text).lstrip("0"))
        case.expect(
            count <= 6 and "e" not in text.lower(),
            f"Strength is {text!r}, not of at most six digits and without exponent",
        )


@wireless("getss.symmetric", "Both hear each other alike", "4.5", Severity.INFORMATIVE)
async def symmetric(case: Case) -> None:
    """In the models of the original the strength is the same in both directions."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        there = number(await _strength(case, one, other))
        back = number(await _strength(case, other, one))
        case.expect(abs(there - back) < 0.5, f"Strength is {back} back, not {there}, as there")


@wireless("getss.self", "The strength of oneself", "11.71, 4.2")
async def oneself(case: Case) -> None:
    """Asked about itself a robot hears infinity, and why."""
    async with await Radio.make(case) as radio:
        await radio.client.expect(
            f"GETSS {{Robot {radio.name}}}",
            f"SS {{Robot {radio.name}}} {{Strength INF}} {{Error SS.To.Self}}",
        )


@wireless("getss.stranger", "The strength of nobody", "11.71, 4.2")
async def stranger(case: Case) -> None:
    """A robot that is not registered has the strength NaN, and the reason is named."""
    async with await Radio.make(case) as radio:
        await radio.client.expect(
            "GETSS {Robot Nobody?}",
            "SS {Robot Nobody?} {Strength NaN} {Error Robot.Does.Not.Exist}",
        )


# Who must leave.


@wireless("kick.ghost", "Who is not in the simulator is dropped", "11.76, 4.4")
async def ghost(case: Case) -> None:
    """A registered name that the simulator does not list is dropped: its connection is closed
    within some seconds. Not asked of a model that does not look at the simulator."""
    async with await Radio.make(case) as radio:
        client = await _client(case)
        name = f"Ghost{case.new_name()}"
        await client.expect(f"INIT {{Robot {name}}} {{Port 5}}", "INITREPLY {Status OK}")
        gone = await side_lines.dropped(client.wire, radio.client)
        case.expect(
            gone, f"the connection that registered {name}, a name that no robot has, is not closed"
        )
        await radio.client.ask("GETSS {Robot Nobody?}")


@wireless("kick.leaver", "Who leaves the simulator is dropped", "11.76, 4.4")
async def leaver(case: Case) -> None:
    """When the robot of a registered name is removed, its connection is closed within some
    seconds; others stay registered."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        other.robot.close()
        gone = await side_lines.dropped(other.client.wire, one.client)
        case.expect(gone, f"the connection of {other.name}, a robot that left, is not closed")
        await one.client.ask("GETSS {Robot Nobody?}")


_EVERY_BYTE = bytes(range(256)) * 16


def _judge_bytes(case: Case, found: bytes, sent: bytes, way: str = "") -> None:
    """Fail unless what arrived is what was sent.

    Args:
        case: the check.
        found: what arrived.
        sent: what was sent.
        way: where, with a blank behind.
    """
    pairs = enumerate(zip(found, sent, strict=False))
    first = next((at for at, (one, other) in pairs if one != other), min(len(found), len(sent)))
    case.expect(
        found == sent,
        f"{way}{len(found)} of {len(sent)} bytes arrived; from byte {first + 1} on they are "
        f"{found[first : first + 8].hex(' ') or 'nothing'}, not "
        f"{sent[first : first + 8].hex(' ') or 'nothing'}",
    )


async def _received(case: Case, wire: Wire, data: bytes, way: str) -> None:
    found = await wire.read_exactly(len(data), side_lines.CARRIES)
    _judge_bytes(case, found, data, f"{way} ")


@wireless("dns.form", "DNS tells a port", "4.2")
async def form(case: Case) -> None:
    """`DNS {Robot other}` is answered by `DNSREPLY {Robot other} {Port p}`."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        line = await one.client.ask(f"DNS {{Robot {other.name}}}")
        pattern = rf"DNSREPLY \{{Robot {other.name}\}} \{{Port \d+\}}"
        case.expect(
            re.fullmatch(pattern, line),
            f"DNS is answered by {line!r}, not by DNSREPLY {{Robot {other.name}}} {{Port p}}",
        )


@wireless("dns.stable", "A pair keeps its port", "11.72, 4.3")
async def stable(case: Case) -> None:
    """Repeated queries of a pair tell the same port; the other direction has another."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        ports = [await one.road(other) for _ in range(3)]
        case.expect(
            len(set(ports)) == 1, f"three queries of a pair tell the ports {ports}, not one"
        )
        back = await other.road(one)
        case.expect(back != ports[0], f"Port is {back} back, not another than {ports[0]}, as there")


@wireless("dns.first-port", "Without a port the first one is meant", "4.3")
async def first_port(case: Case) -> None:
    """DNS without a port leads to the first one that the other has registered."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        plain = await one.road(other)
        named = await one.road(other, f" {{Port {other.port}}}")
        case.expect(
            plain == named,
            f"Port is {plain} for DNS without a port, not {named}, as with the first one named",
        )


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
        port = guest.wire.peer_port
        await other.client.expect(
            f"REVERSEDNS {{Port {port}}}", f"REVERSEDNSREPLY {{Port {port}}} {{Robot {one.name}}}"
        )


@wireless("reversedns.unknown", "REVERSEDNS of a strange port", "4.2")
async def unknown_port(case: Case) -> None:
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
        _judge_bytes(case, data, _EVERY_BYTE)


@wireless("relay.back", "Bytes come back", "11.73, 4.3")
async def back(case: Case) -> None:
    """The other robot answers on the same connection, and its bytes arrive unchanged."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        wire, guest = await one.call(other)
        await guest.wire.send(_EVERY_BYTE)
        await _received(case, wire, _EVERY_BYTE, "on the way back")


@wireless("relay.much", "Much data passes", "4.3")
async def much(case: Case) -> None:
    """A megabyte arrives whole and in order."""
    data = b"".join(number.to_bytes(4) for number in range(262_144))
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        wire, guest = await one.call(other)
        await wire.send(data)
        found = await guest.read(len(data))
        _judge_bytes(case, found, data)


@wireless("relay.hangup", "The end of one side ends the other", "4.3")
async def hangup(case: Case) -> None:
    """When one robot hangs up, the other's connection ends too, behind the last bytes; in either
    direction."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        wire, guest = await one.call(other)
        await wire.send(b"last words")
        wire.close()
        _judge_bytes(case, await guest.read(10), b"last words")
        case.expect(
            await guest.hung_up(),
            f"the connection of {other.name} is not closed within {side_lines.LEAVES:g} s after "
            "the caller hung up",
        )
        wire, guest = await one.call(other)
        guest.wire.close()
        case.expect(
            await wire.hung_up(side_lines.LEAVES),
            f"the connection of {one.name}, which called, is not closed within "
            f"{side_lines.LEAVES:g} s after the other hung up",
        )


@wireless("relay.half-close", "Half-closed connections still carry", "4.3", Severity.SHOULD)
async def half_close(case: Case) -> None:
    """What was sent before an end of file arrives in full."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        wire, guest = await one.call(other)
        await wire.send(_EVERY_BYTE * 8)
        wire.half_close()
        found = await guest.read(len(_EVERY_BYTE) * 8 + 1)
        _judge_bytes(case, found, _EVERY_BYTE * 8)


@wireless("relay.several", "Several connections of a pair", "4.3", Severity.SHOULD)
async def several(case: Case) -> None:
    """A pair may have several connections at a time; their bytes are not mixed up."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        pairs = [await one.call(other) for _ in range(3)]
        for number, (wire, _) in enumerate(pairs):
            await wire.send(bytes([number]) * 1000)
        for number, (_, guest) in enumerate(pairs):
            data = await guest.read(1000)
            sent = bytes([number]) * 1000
            _judge_bytes(case, data, sent, f"connection {number + 1}: ")


@wireless("relay.refused", "The other does not listen", "4.3")
async def refused(case: Case) -> None:
    """If the other robot refuses the connection, the caller is accepted and then hung up."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        port = await one.road(other)
        other.deaf()
        wire = await one.dial(port)
        case.expect(
            await wire.hung_up(side_lines.LEAVES),
            f"the connection of {one.name}, which called, is not closed within "
            f"{side_lines.LEAVES:g} s, though the other refuses it",
        )


@wireless("relay.leaver", "A road closes with its robot", "4.4")
async def relay_leaver(case: Case) -> None:
    """When a robot leaves the simulator, its relayed connections are closed."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        wire, guest = await one.call(other)
        other.robot.close()
        case.expect(
            await side_lines.dropped(wire, one.client),
            f"the connection of {one.name}, which called, is not closed after the other robot left",
        )
        case.expect(
            await guest.hung_up(),
            f"the connection of {other.name}, a robot that left, is not closed within "
            f"{side_lines.LEAVES:g} s",
        )
