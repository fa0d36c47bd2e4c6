"""A small wireless simulation: everybody hears everybody."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import dataclass, field
from functools import partial

from usarsim_conformance.mutants.side_world import MiniWorld, groups_of

_LOOK = 0.2
"""s between two looks at the robots of the simulator."""


@dataclass(eq=False)
class _Station:
    writer: asyncio.StreamWriter
    name: str = ""
    ports: list[int] = field(default_factory=list)


class MiniWireless:
    """Registration, names, strengths and relays."""

    def __init__(self, world: MiniWorld) -> None:
        self._world = world
        self._has = world.has
        self._stations: dict[str, _Station] = {}
        self._servers: list[asyncio.Server] = []
        self._roads: dict[tuple[str, str, int], asyncio.Server] = {}
        self._callers: dict[int, str] = {}
        self._relays: dict[str, list[asyncio.StreamWriter]] = {}

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one robot."""
        station = _Station(writer)
        watch = asyncio.create_task(self._watch(station))
        try:
            held = b""
            while data := await reader.read(65536):
                *lines, held = (held + data).split(b"\n")
                for line in lines:
                    reply = await self._answer(station, line.decode("latin-1").strip())
                    writer.write(f"{reply}\r\n".encode("latin-1"))
                await writer.drain()
        finally:
            watch.cancel()
            if self._stations.get(station.name) is station:
                del self._stations[station.name]

    def close(self) -> None:
        """Stop relaying."""
        for server in self._servers:
            server.close()
        for writers in self._relays.values():
            for writer in writers:
                writer.close()

    async def _watch(self, station: _Station) -> None:
        while True:
            await self._world.ticks.sleep(_LOOK)
            present = any(robot.name == station.name for robot in self._world.robots)
            if station.name and not present and not self._has("wireless-keeps"):
                station.writer.close()
                for writer in self._relays.pop(station.name, []):
                    writer.close()
                return

    async def _answer(self, station: _Station, line: str) -> str:
        verb, groups = line.partition(" ")[0], groups_of(line)
        robot, port = groups.get("robot", ""), groups.get("port", "")
        if not station.name and verb != "INIT" and not self._has("wireless-no-init"):
            return "ERROR {Reason Must.Use.INIT.Method.First}"
        match verb:
            case "INIT" if not station.name or self._has("wireless-init-twice"):
                return self._init(station, robot, port)
            case "GETSS":
                return self._strength(station, robot)
            case "DNS":
                return await self._dns(station, robot, port)
            case "REVERSEDNS":
                if not port.isdecimal():
                    return "ERROR {Reason Port.Must.Be.Integer}"
                name = self._callers.get(int(port))
                if self._has("wireless-reverse") and name:
                    name = station.name
                end = f"{{Robot {name}}}" if name else "{Error UnknownOrIllegalPort}"
                return f"REVERSEDNSREPLY {{Port {port}}} {end}"
        return "ERROR {Reason Method.Unknown.Or.Can.INIT.only.once}"

    def _init(self, station: _Station, robot: str, ports: str) -> str:
        texts = ports.split(",")
        if not all(text.isdecimal() for text in texts):
            return "ERROR {Reason Ports.List.Must.Be.Integer}"
        if not robot:
            return "ERROR {Reason Robot.Name.Must.Not.Be.Empty}"
        if robot in self._stations:
            word = "Already" if self._has("wireless-spelling") else "Alread"
            return f"ERROR {{Reason Robot.{word}.Exists}}"
        station.name, station.ports = robot, [int(text) for text in texts]
        self._stations[robot] = station
        return "INITREPLY {Status OK}"

    def _strength(self, station: _Station, robot: str) -> str:
        head = f"SS {{Robot {robot}}} {{Strength "
        if robot == station.name:
            return head + ("0}" if self._has("wireless-hears-self") else "INF} {Error SS.To.Self}")
        if robot not in self._stations:
            return head + "NaN} {Error Robot.Does.Not.Exist}"
        return head + ("40}" if self._has("wireless-positive") else "-52.6803}")

    async def _dns(self, station: _Station, robot: str, port: str) -> str:
        head = f"DNSREPLY {{Robot {robot}}} {{Port "
        other = self._stations.get(robot)
        if other is None or other is station:
            return head + "-1} {Error NoSuchRobot}"
        if port and not port.isdecimal():
            return "ERROR {Reason Port.Must.Be.Integer}"
        wanted = int(port) if port else other.ports[-1 if self._has("wireless-last-port") else 0]
        if wanted not in other.ports:
            return head + "-1} {Error RobotDoesNotListenOnThisPort}"
        key = (station.name, robot, wanted)
        if key not in self._roads or self._has("wireless-new-ports"):
            relay = partial(self._relay, station.name, robot, wanted)
            self._roads[key] = await asyncio.start_server(relay, "127.0.0.1", 0)
            self._servers.append(self._roads[key])
        return f"{head}{self._roads[key].sockets[0].getsockname()[1]}}}"

    async def _relay(
        self,
        name: str,
        other: str,
        port: int,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
    ) -> None:
        try:
            there, back = await asyncio.open_connection("127.0.0.1", port)
        except OSError:
            writer.close()
            return
        self._callers[back.get_extra_info("sockname")[1]] = name
        self._relays.setdefault(other, []).extend((writer, back))
        await asyncio.gather(self._pump(reader, back), self._pump(there, writer))

    async def _pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while data := await reader.read(2048):
                if self._has("wireless-text-only"):
                    data = data.replace(b"\0", b"")
                writer.write(data)
                await writer.drain()
        if not self._has("wireless-half-open"):
            writer.close()
