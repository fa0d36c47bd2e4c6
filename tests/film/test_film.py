"""`usarsim film`: who is where in its frames, how long it is, and what bad files are answered."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from usarsim_operator import packets
from usarsim_operator.film import command
from usarsim_operator.recording import Recording, RecordingError, Text, Writer
from usarsim_report.films import write_film
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cli import build_parser

GREY, RED, BLUE, GREEN = (0.3, 0.3, 0.3), (0.9, 0.0, 0.0), (0.0, 0.0, 0.9), (0.0, 0.9, 0.0)
SIZE = (160, 120)
ABOVE = ("--eye=0,0,-10", "--at=0,0,0")
"""Straight down: x is up in the picture, y of MuJoCo's frame to the left."""


def box(colour: Sequence[float], half: float = 0.5) -> dict[str, Any]:
    """Geoms and materials of a box that shines by itself."""
    geom = {"shape": "box", "size": [half] * 3, "material": 0}
    return {"geoms": [geom], "materials": [{"rgba": [*colour, 1], "emission": 1.0}]}


def kind(name: str, colour: Sequence[float]) -> dict[str, Any]:
    made = box(colour)
    bodies = [{"body": "base", "geoms": made["geoms"]}]
    return {"type": "kind", "id": name, "materials": made["materials"], "bodies": bodies}


SCENE = {
    "type": "scene",
    "world": "stage",
    "lower": [-6, -6, -1],
    "upper": [6, 6, 3],
    "materials": [{"rgba": [*GREY, 1]}, box(GREEN)["materials"][0]],
    "still": [
        {"what": "world", "name": "", "geoms": [{"shape": "plane", "size": [0, 0], "material": 0}]}
    ],
    "bodies": [
        {"what": "door", "name": "d", "body": "d", "geoms": [
            {"shape": "box", "size": [0.5, 0.5, 0.5], "material": 1}
        ]},
    ],
    "lights": [],
    "headlight": {"ambient": [0.2] * 3, "diffuse": [0.5] * 3, "specular": [0, 0, 0]},
    "views": [{"name": "top", "pos": [0, 0, 12], "quat": [0.7071, 0, 0.7071, 0], "fov": 1.2}],
}  # fmt: skip
DOOR = (-3.0, 3.0)


class Session:
    """Writes a recording."""

    def __init__(self, path: Path) -> None:
        self.writer = Writer(path, {"level": "stage"})
        self.generation = 0

    def say(self, **fields: Any) -> None:
        self.writer.text(0.0, json.dumps(fields))

    def present(self, *names: str) -> None:
        self.generation += 1
        things = [
            {"id": number, "what": "robot", "name": name, "class": "Box", "kind": look}
            | {"first": number + 1}
            for number, (name, look) in enumerate(one.split("=") for one in names)
        ]
        self.say(type="present", generation=self.generation, time=0, count=1 + len(things),
                 things=things)  # fmt: skip

    def poses(self, time: float, *places: tuple[float, float]) -> None:
        rows = np.zeros((1 + len(places), 7), "<f4")
        rows[:, 3] = 1.0
        rows[:, :2] = (DOOR, *places)
        head = packets.head(packets.POSES, packets.SPECTATOR, 0, time)
        counts = struct.pack("<II", self.generation, len(rows))
        self.writer.binary(time, head + counts + rows.tobytes())

    def picture(self, robot: int, time: float, colour: Sequence[float]) -> None:
        image = np.full((30, 40, 3), [round(255 * one) for one in colour[::-1]], np.uint8)
        jpeg = cv2.imencode(".jpg", image)[1].tobytes()
        self.writer.binary(time, packets.head(packets.PICTURE, robot, 0, time) + jpeg)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """R1 goes from y = -2 to y = 2 in 4 s; B is there from 1 s to 2 s; R1's camera sees green."""
    path = tmp_path / "a.rec"
    one = Session(path)
    one.say(**kind("Red", RED))
    one.say(**kind("Blue", BLUE))
    one.say(**SCENE)
    one.say(type="state", robots=[{"name": "R1", "index": 4}])
    one.present("R1=Red")
    for step in range(41):
        time = step / 10.0
        if step == 10:
            one.present("R1=Red", "B=Blue")
        if step == 20:
            one.present("R1=Red")
        blue = [(3.0, -3.0)] if 10 <= step < 20 else []
        one.poses(time, (0.0, time - 2.0), *blue)
        one.picture(4, time, GREEN)
    one.writer.close()
    return path


def film(path: Path, *words: str, out: str = "f.mp4") -> list[NDArray[np.uint8]]:
    """Frames (height, width, 3), red green blue."""
    target = path.with_name(out)
    options = ["film", str(path), "--out", str(target), "--fps=10", "--size=160x120", *words]
    arguments = build_parser(["film"]).parse_args(options)
    assert command.run(arguments) == 0
    return frames(target)


def frames(path: Path) -> list[NDArray[np.uint8]]:
    video, found = cv2.VideoCapture(str(path)), []
    while (read := video.read())[0]:
        found.append(np.asarray(read[1], np.uint8)[..., ::-1])
    return found


def middle(frame: NDArray[np.uint8], colour: Sequence[float]) -> tuple[float, float] | None:
    """Column and row of the middle of what has a colour; None if nothing has."""
    wanted = np.array(colour) > 0.5
    lit, dark = frame[..., wanted].min(axis=2), frame[..., ~wanted].max(axis=2)
    rows, columns = np.nonzero((lit > 120) & (dark < 100))
    return None if len(rows) < 20 else (float(columns.mean()), float(rows.mean()))


def expected(x: float, y: float, height: float) -> tuple[float, float]:
    """Column and row of a place `height` below the eye of `ABOVE`."""
    scale = SIZE[0] / 2.0 / math.tan(math.radians(65.0) / 2.0) / height
    return SIZE[0] / 2.0 - scale * y, SIZE[1] / 2.0 - scale * x


def test_robots_are_where_they_were(session: Path) -> None:
    """Length, places and colours; who comes later or goes is seen only while it is there."""
    found = film(session, *ABOVE)
    assert len(found) == 41
    for number, frame in enumerate(found):
        red = middle(frame, RED)
        assert red is not None
        assert red == pytest.approx(expected(0.0, number / 10.0 - 2.0, 9.5), abs=3.0)
        assert (middle(frame, BLUE) is not None) == (10 <= number < 20)
        assert middle(frame, GREEN) == pytest.approx(expected(*DOOR, 9.5), abs=4.0)


def test_parts_and_speeds(session: Path) -> None:
    """--from, --to and --speed choose simulated times; between two poses things move on."""
    part = film(session, *ABOVE, "--from=1", "--to=2", "--speed=0.5")
    assert len(part) == 21
    columns = [place[0] for one in part if (place := middle(one, RED)) is not None]
    assert len(columns) == 21
    assert columns[0] - columns[-1] == pytest.approx(13.2, abs=2.0)
    assert sum(a > b for a, b in pairwise(columns)) >= 12  # poses alone would make 10


def test_the_same_options_give_the_same_frames(session: Path) -> None:
    one, two = (film(session, "--view=orbit", "--speed=4", out=out) for out in ("1.mp4", "2.mp4"))
    assert len(one) == 11
    assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))
    assert all(middle(frame, RED) is not None for frame in one)


@pytest.mark.parametrize("view", ["follow:r1", "top", "first:B"])
def test_views(session: Path, view: str) -> None:
    """Following keeps the robot in the middle; the first person of B looks along x, at nobody."""
    found = film(session, f"--view={view}", "--speed=4")
    places = [middle(frame, RED) for frame in found]
    if view == "first:B":
        assert len(found) == 3  # it is there for 0.9 s
        assert places == [None] * 3
        return
    assert None not in places
    if view == "follow:r1":
        assert all(abs(place[0] - 80.0) < 40.0 for place in places if place is not None)


def test_camera_pictures_need_no_poses(tmp_path: Path) -> None:
    """A recording of a server without a scene port has a film, too: what cameras took."""
    one = Session(tmp_path / "b.rec")
    one.say(type="state", robots=[{"name": "R1", "index": 0}])
    for step, colour in enumerate((RED, RED, GREEN, GREEN)):
        one.picture(0, step / 2.0, colour)
    one.writer.close()
    found = film(tmp_path / "b.rec", "--view=camera:R1")
    assert len(found) == 16
    assert [middle(found[number], RED) is not None for number in (0, 9, 11)] == [True, True, False]
    with pytest.raises(UsarsimError, match="has no poses"):
        film(tmp_path / "b.rec")


def test_two_servers_one_after_the_other(tmp_path: Path) -> None:
    """A new scene begins at time 0 again; the film goes on."""
    one = Session(tmp_path / "c.rec")
    for colour in (RED, BLUE):
        one.say(**kind("Any" + str(colour), colour))
        one.say(**SCENE)
        one.present(f"R1=Any{colour}")
        for step in range(50):
            one.poses(step / 10.0, (0.0, 0.0))
    one.writer.close()
    found = film(tmp_path / "c.rec", *ABOVE)
    assert len(found) == 99
    assert middle(found[10], RED) is not None
    assert middle(found[60], BLUE) is not None
    assert middle(found[60], RED) is None


def test_interrupted_film_can_be_played(tmp_path: Path) -> None:
    """What was drawn before the signal."""
    stopped: list[bool] = []

    def some() -> Any:
        for number in range(100):
            if number == 20:
                stopped.append(True)
            yield np.full((120, 160, 3), 200, np.uint8)

    out = tmp_path / "f.mp4"
    assert write_film(out, some(), 100, 30.0, SIZE, stopped) == 21
    assert len(frames(out)) == 21
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--view=follow:R9"], "R9 is not in the recording .follow: R1, B."),
        (["--view=camera:B"], "B is not in the recording .camera: R1."),
        (["--view=upwards"], "'upwards' is none of orbit, top"),
        (["--view=follow"], "'follow' is none of"),
        (["--eye=0,0,-1"], "--eye and --at belong together"),
        (["--eye=0,0,-1", "--at=0,0,-1"], "two places"),
        (["--from=9"], "nothing between --from and --to .the recording has 0.0 s to 4.0 s."),
        (["--from=nan"], "nothing between"),
    ],
)
def test_options_that_cannot_be(session: Path, words: list[str], problem: str) -> None:
    """One error that says what is there."""
    with pytest.raises(UsarsimError, match=problem):
        film(session, *words)


def test_files_that_are_none(tmp_path: Path, session: Path) -> None:
    """Missing, foreign, of another format, damaged, cut off."""
    with pytest.raises(RecordingError, match=r"no\.rec: cannot be read: No such file"):
        Recording(tmp_path / "no.rec")
    foreign = tmp_path / "x.rec"
    for data in (b"", b"hello, this is a text and no recording", b"\0" * 100):
        foreign.write_bytes(data)
        with pytest.raises(RecordingError, match="is no recording of a console"):
            Recording(foreign)
    data = session.read_bytes()
    foreign.write_bytes(data.replace(b'_recording": 1', b'_recording": 7'))
    with pytest.raises(RecordingError, match="has format 7"):
        Recording(foreign)
    whole = list(Recording(session))
    foreign.write_bytes(data[:-100])
    assert len(list(Recording(foreign))) == len(whole) - 1
    foreign.write_bytes(data[:3000] + b"\xff" * 4000 + data[7000:])
    with pytest.raises(RecordingError, match=r"x\.rec: byte \d+: is damaged"):
        list(Recording(foreign))


def test_writer_refuses_what_is_there_and_ends_whole(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An old recording is never written over; where the disk is full the file ends whole."""
    with pytest.raises(RecordingError, match="exists already"):
        Writer(session, {})
    with pytest.raises(RecordingError, match="cannot be written"):
        Writer(session.parent / "no" / "a.rec", {})
    writer = Writer(session.with_name("d.rec"), {})
    writer.text(1.0, '{"type": "note"}')
    file = writer._file

    class Full:
        closed = False

        def write(self, data: bytes) -> int:
            if len(data) > 8:
                return file.write(data[: len(data) // 2])
            raise OSError(28, "No space left on device")

        def truncate(self, size: int) -> int:
            return file.truncate(size)

    monkeypatch.setattr(writer, "_file", Full())
    with pytest.raises(OSError, match="No space"):
        writer.text(2.0, '{"type": "never"}')
    found = list(Recording(writer.path))
    assert [one.fields["type"] for one in found if isinstance(one, Text)] == ["note"]
