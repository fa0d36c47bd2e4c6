"""`usarsim robots --check`: what authors of robot files see before any client does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from usarsim_server.cli import main

ROVER = """
description = "a small two-wheeled rover with a laser"
kind = "differential"
dialect = "ut2004"
aliases = ["MiniRover"]

[drive]
max_wheel_speed = 8.0

[[shape]]
kind = "box"
size = [0.30, 0.20, 0.10]
mass = 4.0
position = [-0.03, 0, 0]
color = [0.8, 0.1, 0.1]

[[wheel]]
name = "LeftWheel"
position = [0, -0.13, 0.04]
radius = 0.08
width = 0.03
mass = 0.4

[[wheel]]
name = "RightWheel"
position = [0, 0.13, 0.04]
radius = 0.08
width = 0.03
mass = 0.4

[[caster]]
position = [-0.13, 0, 0.09]
radius = 0.03
mass = 0.1

[[sensor]]
type = "SICK"
name = "Scanner1"
position = [0.1, 0, -0.10]
"""


@pytest.fixture
def rover(tmp_path: Path) -> Path:
    """A robot file that is good."""
    path = tmp_path / "Rover.toml"
    path.write_text(ROVER)
    return path


def squeezed(text: str) -> list[str]:
    """Lines with runs of blanks made one."""
    return [" ".join(line.split()) for line in text.splitlines()]


def fact(lines: list[str], name: str) -> float:
    """The number behind a name."""
    line = next(line for line in lines if line.startswith(f"{name} "))
    return float(line.removeprefix(f"{name} ").split()[0])


def refused(path: Path, text: str, capsys: pytest.CaptureFixture[str]) -> str:
    """The one error line that a file earns."""
    path.write_text(text)
    assert main(["robots", "--check", str(path)]) == 2
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1
    assert errors.startswith(f"error: {path}")
    assert errors.rstrip().endswith(")"), "says what to do"
    return errors


def test_a_good_file_shows_all_that_clients_will_see(
    rover: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Names, lines in both dialects, sensors with their type on the wire, rest, speed; exit 0."""
    assert main(["robots", "--check", str(rover)]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    lines = squeezed(captured.out)
    assert lines[0] == "Rover: a small two-wheeled rover with a laser"
    assert "also called MiniRover" in lines
    assert "STA in ut2004 Type GroundVehicle" in lines
    assert "Scanner1 RangeScanner 0.2 s 0.2 s" in lines
    assert sum(line.startswith("CONF {Type GroundVehicle} {Name Rover}") for line in lines) == 1
    assert sum(line.startswith("CONF {Name Rover} {Type GroundVehicle}") for line in lines) == 1
    assert sum(line.startswith("GEO {Type RangeScanner} {Name Scanner1") for line in lines) == 2
    assert sum(line.startswith("STA {Type GroundVehicle} {Time ") for line in lines) == 2
    # By the robot file: axles 0.04 below the reference point, 8 rad/s, radius 0.08 m.
    assert fact(lines, "rest height") == 0.12
    assert fact(lines, "stands at") == pytest.approx(0.12, abs=1e-3)
    assert fact(lines, "top speed") == pytest.approx(0.64, rel=0.01)
    assert fact(lines, "leans by") < 1.0
    assert fact(lines, "drifts by") < 0.1
    assert 0.0 < fact(lines, "sinks in by") < 1.0


def test_a_variant_finds_what_it_extends_beside_it_and_among_the_shipped(
    rover: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`extends` works for a neighbour and for P2AT; the announced name is that of the file."""
    for name, parent in (("Fast", "Rover"), ("MyP2AT", "P2AT")):
        path = tmp_path / f"{name}.toml"
        path.write_text(f'extends = "{parent}"\n[drive]\nmax_wheel_speed = 4.0\n')
        assert main(["robots", "--check", str(path)]) == 0
        assert f"{{Name {name}}} {{SteeringType SkidSteered}}" in capsys.readouterr().out


def test_the_picture_shows_the_robot(
    rover: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`--out` draws it, red as it is, in the middle and free of the edges."""
    target = tmp_path / "rover.png"
    assert main(["robots", "--check", str(rover), "--out", str(target)]) == 0
    picture = np.asarray(Image.open(target).convert("RGB")).astype(int)
    assert picture.shape == (720, 960, 3)
    red = (picture[..., 0] > 60) & (picture[..., 0] > 2 * picture[..., 1:].max(axis=2))
    assert 0.1 < red.mean() < 0.7
    rows, columns = np.nonzero(red)
    assert 0 < rows.min() < 360 < rows.max() < 719
    assert 0 < columns.min() < 480 < columns.max() < 959


def test_a_picture_that_cannot_be_written_is_an_error(
    rover: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder that does not exist, or `--out` with nothing to draw: one line, exit code 2."""
    target = tmp_path / "nowhere" / "rover.png"
    assert main(["robots", "--check", str(rover), "--out", str(target)]) == 2
    assert f"{target}: cannot be written" in capsys.readouterr().err
    assert main(["robots", "--out", str(target)]) == 2
    assert "--check FILE" in capsys.readouterr().err


def test_a_file_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is named."""
    for path in (tmp_path / "None.toml", tmp_path / "nowhere" / "None.toml"):
        assert main(["robots", "--check", str(path)]) == 2
        assert str(path.parent) in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('kind = "differential"', 'kind = "hovercraft"', "hovercraft"),
        ("max_wheel_speed = 8.0", "max_wheel_sped = 8.0", "max_wheel_speed: is missing"),
        ('type = "SICK"', 'type = "SICKK"', "SICKK"),
        ('name = "Scanner1"\n', 'name = "Scanner1"\nmax_rnge = 1\n', "max_rnge"),
        ("aliases", "extends = 'Nobody'\naliases", "Nobody"),
        ('kind = "box"', 'kind = "box', "TOML"),
    ],
)
def test_mistakes_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, problem: str
) -> None:
    """Slips of the pen, in tables of bodies and of sensors: file, place, cure; exit code 2."""
    assert old in ROVER
    text = refused(tmp_path / "Rover.toml", ROVER.replace(old, new, 1), capsys)
    assert problem in text


def test_a_robot_that_falls_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without its caster the rover sits down on its tail."""
    start, end = ROVER.index("[[caster]]"), ROVER.index("[[sensor]]")
    text = refused(tmp_path / "Rover.toml", ROVER[:start] + ROVER[end:], capsys)
    assert "leans by" in text


def test_a_robot_too_weak_to_move(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Wheels without torque do not turn a body that drags on the floor."""
    weak = ROVER.replace(
        "[[caster]]",
        "[[shape]]\nkind = 'box'\nsize = [0.1, 0.1, 0.02]\nmass = 20\n"
        "position = [-0.05, 0, 0.112]\n\n[[caster]]",
        1,
    )
    text = refused(
        tmp_path / "Rover.toml",
        weak.replace("max_wheel_speed = 8.0", "max_wheel_speed = 8.0\nwheel_torque = 0.01"),
        capsys,
    )
    assert "does not move" in text
