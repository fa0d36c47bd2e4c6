"""`usarsim snapshot`: pictures of worlds without a server."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from usarsim_server.cli import main

SMALL = ("--size", "64x48", "--renderer", "rays", "--after", "0.1")


def draw(file: Path, *arguments: str) -> Image.Image:
    """Run the command and read its picture."""
    assert main(["snapshot", str(file), "--world", "empty", *SMALL, *arguments]) == 0
    return Image.open(file)


def test_a_picture_with_a_robot(tmp_path: Path) -> None:
    """The file has the size asked for, and the robot is in the picture."""
    view = ("--view=-2,0,-1,0,0,0",)
    bare = draw(tmp_path / "bare.png", *view)
    full = draw(tmp_path / "full.png", *view, "--robot", "P3AT@0,0,-0.3,0.5")
    assert bare.size == full.size == (64, 48)
    assert full.format == "PNG"
    changed = np.asarray(bare.convert("RGB")) != np.asarray(full.convert("RGB"))
    assert 20 < changed.any(axis=-1).sum() < 64 * 48 / 2


def test_depth_in_millimetres(tmp_path: Path) -> None:
    """16 bits of millimetres along the axis; 0 where there is nothing."""
    image = draw(tmp_path / "d.png", "--mode", "depth", "--view", "0,0,-3,0,0,0")
    values = np.asarray(image)
    assert values.dtype.kind in "iu"
    assert values == pytest.approx(np.full((48, 64), 3000), abs=2)
    up = np.asarray(draw(tmp_path / "u.png", "--mode", "depth", "--view", "0,0,-1,0,0,-9"))
    assert not up.any()


def test_segmentation_lists_its_colours(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every object has a colour; the list names robots by their labels."""
    robot = ("--robot", "P3AT@0,0,-0.3")
    file = tmp_path / "s.png"
    image = draw(file, "--mode", "segmentation", "--view=-1.5,0,-1,0,0,0", *robot)
    lines = capsys.readouterr().out.splitlines()
    listed = {line.split()[-1]: line.split()[0] for line in lines[1:]}
    assert "P3AT" in listed
    found = {"#" + bytes(color).hex() for color in np.asarray(image).reshape(-1, 3).tolist()}
    assert set(listed.values()) <= found


def test_the_camera_of_a_robot(tmp_path: Path) -> None:
    """ROBOT/CAMERA is what the robot's own camera sees; --fov changes that."""
    wide = np.asarray(draw(tmp_path / "w.png", "--view", "P3AT/Camera", "--robot", "P3AT"))
    narrow = np.asarray(
        draw(tmp_path / "n.png", "--view", "P3AT/Camera", "--robot", "P3AT", "--fov", "30")
    )
    assert (wide != narrow).any()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--view", "nowhere"), "there is no view 'nowhere'"),
        (("--view", "P3AT/Camera"), "there is no view"),
        (("--robot", "P4AT"), "no class 'P4AT'"),
        (("--robot", "P3AT@1,2"), "no place"),
        (("--robot", "P3AT@nan,0,0"), "error:"),
        (("--world", "atlantis"), "atlantis"),
    ],
)
def test_mistakes_end_in_one_line(
    arguments: tuple[str, ...], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2 and one line that says what to write."""
    file = tmp_path / "x.png"
    assert main(["snapshot", str(file), "--world", "empty", *SMALL, *arguments]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not file.exists()


def test_a_file_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder that does not exist is named."""
    file = tmp_path / "no" / "x.png"
    assert main(["snapshot", str(file), "--world", "empty", *SMALL]) == 2
    assert "cannot be written" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [("--size", "0x9"), ("--size", "big"), ("--fov", "200"), ("--after", "-1"), ("--mode", "ir")],
)
def test_impossible_values_are_refused(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    """The parser names the option."""
    with pytest.raises(SystemExit) as ending:
        main(["snapshot", "x.png", *arguments])
    assert ending.value.code == 2
    assert arguments[0] in capsys.readouterr().err
