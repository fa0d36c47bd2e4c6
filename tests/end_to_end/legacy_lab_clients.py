"""Legacy clients of laboratories and courses, narrow as they were (protocol 5.1)."""

from __future__ import annotations

import contextlib
import re
import time

from legacy_clients import LegacyClient, Vector, vector_of

from usarsim_server.testing import PATIENCE, time_of


class AutToolbox(LegacyClient):
    """MATLAB functions: flush 4096 bytes, wait half a second for a line with a pattern
    (protocol 5.1.6)."""

    timeout = 0.5
    """s that a function waits; of simulated time here, as the lines tell it."""

    def sense(self, wire_type: str) -> str:
        """The next line of a type; its first line may be torn and is passed over."""
        self._flush()
        begun: float | None = None
        while True:
            line = self.read_line()
            if line.startswith("SEN") and f"{{Type {wire_type}}}" in line:
                return line
            now = time_of(line)
            begun = now if begun is None else begun
            if now is not None and begun is not None and now > begun + self.timeout:
                raise TimeoutError(f"no {wire_type} within {self.timeout} s")

    def _flush(self) -> None:
        self._buffer = b""
        with contextlib.suppress(BlockingIOError):
            self.socket.setblocking(False)
            while self.socket.recv(4096):
                pass
        self.socket.settimeout(PATIENCE)

    def pass_by(self, seconds: float) -> None:
        """A pause in the script, in simulated time, during which it does not look at lines."""
        begun: float | None = None
        while True:
            now = time_of(self.read_line())
            begun = now if begun is None else begun
            if now is not None and begun is not None and now >= begun + seconds:
                return

    def vector(self, wire_type: str, key: str) -> Vector:
        """Numbers behind `{Key `, exactly one blank."""
        line = self.sense(wire_type)
        place = line.index("{" + key + " ") + len(key) + 2
        return vector_of(line[place : line.index("}", place)])

    def sonars(self) -> dict[str, float]:
        """Names and ranges, which must come in pairs."""
        line = self.sense("Sonar")
        names = re.findall(r"\{Name (\w+)", line)
        ranges = re.findall(r"Range ([-\d.]+)", line)
        return {name: float(text) for name, text in zip(names, ranges, strict=True)}


class Rdk(LegacyClient):
    """RDK reads words in sequence and wants small `status`, View and Battery (protocol 5.1.7).

    Attributes:
        status: (battery, view) of the last STA it accepted.
        scans: lengths of the laser lines. tags: ids in sight. confirmed: types of good RES.
    """

    laser_buffer = 2048

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.status: tuple[int, int] | None = None
        self.scans: list[int] = []
        self.tags: set[int] = set()
        self.confirmed: list[str] = []

    def first_start_pose(self) -> tuple[str, str]:
        """Ask, look at the next line only, ask again; location and rotation as text."""
        while True:
            self.send("GETSTARTPOSES")
            words = self.read_line().split()
            if words[:2] == ["NFO", "{StartPoses"] and int(words[2].removesuffix("}")) > 0:
                tag, location, rotation = words[3:6]
                assert tag.startswith("{")
                return location, rotation.removesuffix("}")

    def step(self) -> None:
        """Read a line; the second word must be `{Time` or `{Type`."""
        line = self.read_line()
        words = line.split(" ")
        if words[0] not in ("STA", "SEN", "RES"):
            return
        assert words[1] in ("{Time", "{Type"), line
        if words[0] == "STA" and "{View" in words and "{Battery" in words:
            found = [words[words.index(key) + 1] for key in ("{Battery", "{View")]
            self.status = (int(found[0].removesuffix("}")), int(found[1].removesuffix("}")))
        elif words[0] == "RES" and "{status" in words and line.endswith("OK}"):
            self.confirmed.append(words[words.index("{Type") + 1].removesuffix("}"))
        elif "{Type RangeScanner}" in line:
            assert len(line) < self.laser_buffer
            self.scans.append(len(line))
        elif "{Type RFID}" in line:
            places = [index for index, word in enumerate(words) if word == "{ID"]
            for place in places:
                assert words[place + 2] == "{Location"
                assert words[place + 4] == "{Mem"
                self.tags.add(int(words[place + 1].removesuffix("}")))


class UvaStudent(LegacyClient):
    """Python: chunks of 1024 bytes, each split for itself; fixed places in the line
    (protocol 5.1.8).

    Attributes:
        pose: of the last Odometry line. sonars: F1..F8. results: types of RES lines.
    """

    pattern = re.compile(r"\{[^\}]+\}|[a-zA-Z]+")

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.pose: Vector = ()
        self.sonars: list[float] = []

    def step(self) -> None:
        """Receive a chunk; pieces of lines at its ends are lost."""
        for line in self.socket.recv(1024).decode("latin-1").split("\r\n"):
            words = self.pattern.findall(line)
            if len(words) < 4 or words[0] != "SEN" or not line.endswith("}"):
                continue
            if words[1] == "{Type Odometry}":
                self.pose = vector_of(words[3].strip("{}").split(" ")[1])
            elif words[2] == "{Type Sonar}" and len(words) >= 11:
                groups = [word.strip("{}").split(" ") for word in words[3:11]]
                assert [group[1] for group in groups] == [f"F{i}" for i in range(1, 9)]
                self.sonars = [float(group[3]) for group in groups]


class UvaRescue(LegacyClient):
    """VB.NET on Mono: lines end in LF; a dictionary per line, the first of a key wins
    (protocol 5.1.9)."""

    end = b"\n"

    def ask(self, question: str, wire_type: str, name: str) -> dict[str, str]:
        """GETGEO or GETCONF of one item; the answer as a dictionary."""
        self.send(f"{question} {{Type {wire_type}}} {{Name {name}}}")
        return self.next(question.removeprefix("GET"))

    def next(self, head: str, wire_type: str | None = None) -> dict[str, str]:
        """The next line with a head and perhaps a type."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            line = self.read_line()
            told: dict[str, str] = {}
            for text in re.findall(r"\{([^{}]*)\}", line):
                key, _, value = text.partition(" ")
                told.setdefault(key, value)
            if line.split(" ", 1)[0] == head and wire_type in (None, told.get("Type")):
                return told
        raise TimeoutError(f"no {head}")


class Ades(LegacyClient):
    """C#: splits every received chunk at line ends, forgets what is left over (protocol 5.1.11)."""

    def chunk(self) -> list[str]:
        """The lines of one chunk, broken ones included."""
        return self.socket.recv(65536).decode("latin-1").split("\r\n")
