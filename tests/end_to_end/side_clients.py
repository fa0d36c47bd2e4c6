"""The programs beside the robots, in miniature: wireless simulation and scoring tools.

They read as the originals do: strictly, by position, once.
"""

from __future__ import annotations

import re
import socket

from usarsim_server.testing import PATIENCE, ScriptedClient


def split_reply(line: str) -> tuple[str, list[dict[str, str]]]:
    """Type and groups of a reply, as the strict splitter of the wireless server finds them.

    One blank and a brace behind the type; exactly one character between groups; words inside a
    group parted by single blanks, taken in pairs (side channels reference 3.4). Whatever stands
    behind the first surprise is lost.
    """
    kind, blank, rest = line.partition(" ")
    groups: list[dict[str, str]] = []
    while blank and rest[:1] == "{":
        inner, brace, rest = rest[1:].partition("}")
        words = inner.split(" ")
        if not brace or len(words) % 2:
            break
        groups.append(dict(zip(words[0::2], words[1::2], strict=True)))
        rest = rest[1:]
    return kind, groups


class WirelessModel:
    """The propagation model that asks on 7435."""

    def __init__(self, port: int) -> None:
        self.client = ScriptedClient(port)

    def positions(self) -> dict[str, tuple[list[float], bool]]:
        """Place and empty battery of every robot, by its name in its own spelling."""
        self.client.send("GETPOS")
        kind, groups = split_reply(self.client.read_line())
        assert kind == "POSITIONS"
        count = int(groups[0]["Robots"])
        robots = {}
        for group in groups[1:]:
            place = [float(part) for part in group["Location"].split(",")]
            assert len(place) == 3
            robots[group["Name"]] = (place, {"True": True, "False": False}[group["BatteryEmpty"]])
        assert len(robots) == count
        return robots

    def obstacles(self, one: str, other: str) -> int | None:
        """Obstacles between two robots; None if one of them is unknown."""
        self.client.send(f"GETOBS {{From {one}}} {{To {other}}}")
        kind, groups = split_reply(self.client.read_line())
        assert (kind, groups[0], groups[1]) == ("NUMOBS", {"From": one}, {"To": other})
        text = groups[2]["ObstCount"].partition(".")[0]
        return int(text) if text.isdecimal() else None


_SCORE_LINE = re.compile(
    r"\{Name ([^}]*)\} \{Class ([^}]*)\} \{Time ([^}]*)\} "
    r"\{Location ([^,}]*),([^,}]*),([^,}]*)\} \{Rotation ([^,}]*),([^,}]*),([^,}]*)\}"
)


class RoboCupScore:
    """Asks every 100 ms without waiting, matches lines from column 0, ignores the rest."""

    def __init__(self, port: int) -> None:
        self.client = ScriptedClient(port)
        self.robots: dict[str, list[float]] = {}
        self.victims: dict[str, list[float]] = {}
        self.listings = 0

    def watch(self, times: int) -> None:
        """Ask so often, then read what has not come yet."""
        wanted = self.listings + times
        for _ in range(times):
            self.client.send("{Actors}")
            for line in self.client.read_for(0.1):
                self._take(line)
        while self.listings < wanted:
            self._take(self.client.read_line())

    def _take(self, line: str) -> None:
        if line == "{End}":
            self.listings += 1
        match = _SCORE_LINE.match(line)
        if match is None:
            return
        kind = match[2].lower()
        place = [float(match[number]) for number in (4, 5, 6)]
        if any(word in kind for word in ("p3at", "kenaf", "airrobot")):
            self.robots[match[1]] = place
        elif any(word in kind for word in ("kasset", "femalevictim", "malevictim")):
            self.victims[match[1]] = place

    def close(self) -> None:
        """Ask once more and hang up at once, as the tool does when its window is closed."""
        self.client.send("{Actors}")
        self.client.close()


class MetricTool:
    """Sends empty lines; takes what is there once, as soon as something is there."""

    CLASSES = ("P3AT", "AirRobot", "Kenaf", "MaleVictim", "FemaleVictim")

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)

    def look(self) -> tuple[dict[str, list[float]], bool]:
        """Place of every actor of a known class; whether the end was in the same read."""
        self.socket.sendall(b"\r\n")
        self.socket.recv(1, socket.MSG_PEEK)
        lines = self.socket.recv(1 << 20).decode("latin-1").split("\n")
        found = {}
        for line in lines:
            if len(line) < 39:
                continue
            match = _SCORE_LINE.fullmatch(line.rstrip("\r"))
            assert match is not None, line
            if match[2] in self.CLASSES:
                found[match[1]] = [float(match[number]) for number in (4, 5, 6)]
        return found, lines[-2:] == ["{End}\r", ""]


class TruthConsole:
    """Asks one query, reads to the end, asks again and quits without reading."""

    def __init__(self, port: int, query: str = "{class USARPhysObj.partc} {name part_c_6}") -> None:
        client = ScriptedClient(port)
        client.send(query)
        self.lines: list[str] = []
        while (line := client.read_line()) != "{End}":
            self.lines.append(line)
        client.send(query)
        client.close()
