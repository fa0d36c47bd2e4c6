"""Legacy controllers in miniature: each keeps the reading rules of one family of programs.

They are deliberately as narrow as the originals (protocol reference 5.1): what breaks the original
breaks these, by an exception or by a field that stays empty. None shares a parser with another.
"""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import ClassVar

from usarsim_server.testing import PATIENCE, Closing

Vector = tuple[float, ...]


class LegacyClient(Closing):
    """A connection; reading is the business of the families."""

    end = b"\r\n"
    """What the program ends its commands with."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)
        self._buffer = b""

    def send(self, text: str, end: bytes | None = None) -> None:
        """Send one command."""
        self.socket.sendall(text.encode("latin-1") + (self.end if end is None else end))

    def read_line(self) -> str:
        """The next line up to LF, as programs on a buffered reader see it."""
        while b"\n" not in self._buffer:
            self._receive()
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.decode("latin-1").removesuffix("\r")

    def step(self) -> None:
        """Read and digest one line, or one chunk."""
        raise NotImplementedError

    def read_until(self, done: Callable[[], bool]) -> None:
        """Take steps until a condition holds."""
        deadline = time.monotonic() + PATIENCE
        self.step()
        while not done():
            if time.monotonic() > deadline:
                raise TimeoutError("the client waits in vain")
            self.step()

    def _receive(self, size: int = 65536) -> None:
        data = self.socket.recv(size)
        if not data:
            raise ConnectionError("the server closed the connection")
        self._buffer += data

    def close(self) -> None:
        """Hang up."""
        self.socket.close()


class Player(LegacyClient):
    """The Player driver: one line of at most 4096 bytes at a time, fields between blanks
    (protocol 5.1.4).

    A pause of 100 ms would end a line early, too. That is not played: a busy machine makes pauses.

    Attributes:
        sonars: ranges by number of the reading.
        scans: laser readings.
        mounts: pose of every item whose GEO was understood.
        limits: (MaxRange, Resolution, Fov) of the laser.
        robot: text fields of the robot's own CONF and GEO.
    """

    limit = 4096

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.sonars: list[dict[str, float]] = []
        self.scans: list[list[float]] = []
        self.mounts: dict[str, tuple[Vector, Vector]] = {}
        self.limits: Vector = ()
        self.robot: dict[str, str] = {}

    def read_line(self) -> str:
        """A line; 4096 bytes would end it early."""
        while b"\n" not in self._buffer:
            self._receive()
        line, _, self._buffer = self._buffer.partition(b"\n")
        assert len(line) + 2 < self.limit, "the rest of this line would be read as another one"
        return line.decode("latin-1").removesuffix("\r")

    def step(self) -> None:
        """Read and digest one line; lines without a Name say nothing to this driver."""
        line = self.read_line()
        if "{Name " not in line:
            return
        head = line.split(" ", 1)[0]
        if head == "SEN" and "{Type Sonar}" in line:
            self.sonars.append(dict(self._named(line)))
        elif head == "SEN" and "{Type RangeScanner}" in line:
            ranges = [float(text) for text in self._field(line, "Range").split(",")]
            assert float(self._field(line, "FOV")) > 0.0
            self.scans.append(ranges)
        elif head == "GEO" and ("{Type Sonar}" in line or "{Type RangeScanner}" in line):
            self._read_mounts(line)
        elif head == "CONF" and "{Type RangeScanner}" in line:
            keys = ("MaxRange", "Resolution", "Fov")
            self.limits = tuple(float(self._field(line, key)) for key in keys)
        elif head in ("CONF", "GEO") and "{Type GroundVehicle}" in line:
            for key in ("SteeringType", "Mass", "MaxSpeed", "MaxTorque", "MaxFrontSteer"):
                self.robot.update({key: self._field(line, key)} if head == "CONF" else {})
            for key in ("Dimensions", "COG", "WheelRadius", "WheelSeparation"):
                self.robot.update({key: self._field(line, key)} if head == "GEO" else {})

    @staticmethod
    def _field(line: str, key: str) -> str:
        """Text from behind the key up to the next blank, less one brace."""
        place = line.index("{" + key + " ") + len(key) + 2
        return line[place:].split(" ", 1)[0].removesuffix("}")

    @staticmethod
    def _named(line: str) -> Iterator[tuple[str, float]]:
        words = line.split(" ")
        for index, word in enumerate(words):
            if word == "{Name":
                assert words[index + 2] == "Range", "no pair of name and range"
                yield words[index + 1], float(words[index + 3].removesuffix("}"))

    def _read_mounts(self, line: str) -> None:
        words = line.split(" ")[3:]
        for index in range(0, len(words), 8):
            mark, name, at, location, turned, rotation, on, _ = words[index : index + 8]
            assert (mark, at, turned, on) == ("{Name", "Location", "Orientation", "Mount")
            self.mounts[name] = (vector_of(location), vector_of(rotation))


class Maldo(LegacyClient):
    """A Java client that cuts behind Type, splits at `} {` and counts the pieces (protocol 5.1.5).

    Attributes:
        read: number of lines understood, by type.
        status: the last STA, all six members.
        values: what the last line of each type told.
    """

    places: ClassVar[dict[str, tuple[str, ...]]] = {
        "GroundTruth": ("Location", "Orientation"),
        "INS": ("Location", "Orientation"),
        "RangeScanner": ("Resolution", "FOV", "Range"),
        "Odometry": ("Pose",),
        "GPS": ("Latitude", "Longitude", "Fix", "Satellites"),
        "Sound": ("Loudness", "Duration"),
        "HumanMotion": ("Prob",),
    }

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.read: dict[str, int] = {}
        self.status: tuple[float, float, bool, int, int, int] | None = None
        self.values: dict[str, list[str]] = {}

    def step(self) -> None:
        """Read one line; anything but SEN and STA is of no interest."""
        line = self.read_line()
        head = line[:3]
        if head not in ("SEN", "STA"):
            return
        begin = line.index("{Type ") + 6
        wire_type = line[begin : line.index("}", begin)]
        pieces = line[begin + len(wire_type) + 3 : -1].split("} {")
        if head == "STA":
            self._read_status(pieces)
        elif wire_type == "Sonar":
            assert len(pieces) == 16, "there are sixteen sonars, no more, no less"
            self.values["Sonar"] = [piece.split(" ")[3] for piece in pieces]
            assert all(float(text) >= 0.0 for text in self.values["Sonar"])
        elif wire_type == "Touch":
            assert pieces[0].split(" ")[3] in ("True", "False")
        elif wire_type in self.places:
            assert pieces[0].startswith("Name ")
            told = [piece.split(" ", 1) for piece in pieces[1:]]
            assert tuple(key for key, _ in told) == self.places[wire_type]
            self.values[wire_type] = [value for _, value in told]
        kind = "STA" if head == "STA" else wire_type
        self.read[kind] = self.read.get(kind, 0) + 1

    def _read_status(self, pieces: list[str]) -> None:
        told = dict(piece.split(" ", 1) for piece in pieces)
        self.status = (
            float(told["FrontSteer"]),
            float(told["RearSteer"]),
            {"True": True, "False": False}[told["LightToggle"]],
            int(told["LightIntensity"]),
            int(told["Battery"]),
            int(told["View"]),
        )


class Ros(LegacyClient):
    """The ROS driver: asks for CONF, then GEO of whatever streams, one at a time (protocol 5.1.1).

    Attributes:
        found: state of every sensor by (type, name): "asked CONF", "asked GEO" or "ready".
        robot: CONF and GEO of the robot together, by key; complete when it has WheelBase.
        scans: range lists of configured scanners. poses: odometry of the configured robot.
        errors: lines that the driver would complain about.
    """

    exempt: ClassVar[frozenset[str]] = frozenset({"Touch", "CO2Sensor"})
    heads: ClassVar[frozenset[str]] = frozenset(
        {"SEN", "NFO", "EFF", "STA", "MISSTA", "ASTA", "CONF", "GEO"}
    )

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.found: dict[tuple[str, str], str] = {}
        self.robot: dict[str, list[str]] = {}
        self.scans: list[list[float]] = []
        self.poses: list[Vector] = []
        self.errors: list[str] = []
        self._waiting: dict[str, tuple[str, str]] = {}

    def step(self) -> None:
        """Read a line, then ask the next question if none of its kind is open."""
        line = self.read_line()
        head = line.split(" ", 1)[0]
        if head not in self.heads:
            self.errors.append(line)
            return
        segments = list(self._segments(line))
        if head in ("CONF", "GEO"):
            self._answered(head, segments)
        elif head == "SEN":
            self._sensed(segments)
        elif head == "STA" and dict(segments).get("Type") != ["GroundVehicle"]:
            self.errors.append(line)
        self._ask()

    @staticmethod
    def _segments(line: str) -> Iterator[tuple[str, list[str]]]:
        """Key and words of each segment; one without a blank ends the reading."""
        for text in line.split("{")[1:]:
            key, blank, rest = text.lstrip(" ").partition(" ")
            if not blank:
                return
            yield key, [word for word in re.split(r"[\s,}]+", rest) if word]

    def _sensed(self, segments: list[tuple[str, list[str]]]) -> None:
        if segments[0][0] == "Time":
            segments = segments[1:]
        (_, (wire_type, *_)), (name_key, (name, *words)) = segments[0], segments[1]
        assert name_key == "Name", "the name must come before the data"
        if wire_type in self.exempt:
            return
        data = dict(segments[2:])
        if wire_type == "Sonar":
            assert (segments[2][0] if not words else words[0]) == "Range"
        if self.found.setdefault((wire_type, name), "new") != "ready":
            return
        if wire_type == "RangeScanner":
            assert segments[-1][0] == "Range"
            self.scans.append([float(word) for word in data["Range"]][191::-1])
        elif wire_type == "Odometry" and "WheelBase" in self.robot:
            self.poses.append(tuple(float(word) for word in data["Pose"]))

    def _answered(self, head: str, segments: list[tuple[str, list[str]]]) -> None:
        told = dict(segments)
        if told["Type"] == ["Camera"] and head not in self._waiting:
            # Comes unasked before the first SEN (side channels reference 2.10).
            return
        item = self._waiting.pop(head)
        assert item[1] in ("rover", told["Name"][0]), "an answer to another question"
        if item[0] == "Robot":
            self.robot.update(told)
        elif head == "GEO":
            names = [key for key, _ in segments]
            words = [word for _, words in segments for word in words]
            for order in ("Name", "Location", "Orientation", "Mount"):
                assert order in names or order in words
        self.found[item] = "ready" if head == "GEO" else "asked GEO"
        if head == "CONF":
            self._question("GEO", item)

    def _ask(self) -> None:
        self.found.setdefault(("Robot", "rover"), "new")
        fresh = next((item for item, state in self.found.items() if state == "new"), None)
        if fresh is not None and not self._waiting:
            self.found[fresh] = "asked CONF"
            self._question("CONF", fresh)

    def _question(self, head: str, item: tuple[str, str]) -> None:
        self._waiting[head] = item
        self.send(f"GET{head} {{Type {item[0]}}} {{Name {item[1]}}}")

    def drive(self, forward: float, turn: float) -> None:
        """Command m/s and anticlockwise rad/s through what CONF and GEO said."""
        radius = float(self.robot["WheelRadius"][0])
        track = float(self.robot["WheelSeparation"][0])
        left, right = ((forward + side * turn * track / 2) / radius for side in (-1, 1))
        self.send(f"Drive {{Left {left:f}}} {{Right {right:f}}}")


class Iridium(LegacyClient):
    """The operator's console: splits at any brace and needs certain keys together (protocol 5.1.2).

    Attributes:
        level: name of the map. starts: start poses by tag.
        battery: s. shown: number of packets digested by type.
    """

    needs: ClassVar[dict[str, str]] = {"Location": "Orientation", "Pos": "Vel"}

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.level = ""
        self.starts: dict[str, tuple[Vector, Vector]] = {}
        self.battery: int | None = None
        self.shown: dict[str, int] = {}

    def step(self) -> None:
        """Read a line; a missing partner would end the reader thread."""
        head, *parts = (part.strip() for part in re.split(r"[{}]", self.read_line()))
        packet: dict[str, str] = {}
        for part in filter(None, parts):
            key, blank, value = part.partition(" ")
            packet.setdefault(key if blank else "Other", value if blank else part)
        if head == "NFO":
            self.level = packet.get("Level", self.level)
            if "StartPoses" in packet:
                self._read_starts(parts)
        elif head == "STA":
            self.battery = int(packet["Battery"])
        elif head == "SEN":
            self._read_sensor(packet)
        self.shown[head] = self.shown.get(head, 0) + 1

    def _read_sensor(self, packet: dict[str, str]) -> None:
        for key, partner in self.needs.items():
            assert (key not in packet) or partner in packet
        wire_type = packet["Type"]
        if wire_type == "GPS":
            int(packet["Fix"])
        if wire_type == "RangeScanner":
            room = round(float(packet["FOV"]) / float(packet["Resolution"])) + 1
            assert len(packet["Range"].split(",")) <= room
        self.shown[wire_type] = self.shown.get(wire_type, 0) + 1

    def _read_starts(self, parts: list[str]) -> None:
        words = " ".join(part for part in parts if not part.startswith("StartPoses")).split()
        for tag, location, rotation in zip(words[::3], words[1::3], words[2::3], strict=True):
            self.starts[tag] = (vector_of(location), vector_of(rotation))


class SliderController(LegacyClient):
    """One question, one line read as its answer; sliders refuse reversed limits (protocol 5.1.3).

    Attributes:
        sliders: (minimum, maximum) by link number of CONF. reached: positions by link number.
    """

    end = b"\n"

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.name = ""
        self.sliders: dict[int, tuple[float, float]] = {}
        self.reached: dict[int, float] = {}

    def start(self, init: str) -> None:
        """The whole opening: INIT, one line, the question, one line."""
        self.send(init)
        self.read_line()
        self.send("GETCONF {Type Actuator}")
        line = self.read_line()
        assert line.startswith("CONF "), f"a slider controller takes this for the answer: {line}"
        link, low = 0, 0.0
        words = line.split(" ")
        for key, text in pairwise(words):
            value = text.removesuffix("}")
            if key == "{Name":
                self.name = value
            elif key == "{Link":
                link = int(value)
            elif key == "{MinValue":
                low = float(value)
            elif key == "{MaxValue":
                assert low <= float(value), "a slider of the Java library refuses this range"
                self.sliders[link] = (low, float(value))

    def step(self) -> None:
        """Read a line; ASTA tells where the links are."""
        words = self.read_line().replace("}", "").split(" ")
        if words[0] == "ASTA":
            links = [index for index, word in enumerate(words) if word == "{Link"]
            self.reached = {int(words[i + 1]): float(words[i + 3]) for i in links}


def vector_of(text: str) -> Vector:
    return tuple(float(part) for part in text.split(","))
