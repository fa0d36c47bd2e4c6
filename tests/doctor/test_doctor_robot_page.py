"""`usarsim robots --page`, and the page that it has made: docs/robots.md."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from PIL import Image

from usarsim_doctor import robot_page
from usarsim_doctor.robot_page import head_comment, write
from usarsim_server.cli import main
from usarsim_server.files import data_directory
from usarsim_server.robots.catalog import Library

DOCS = Path(__file__).parents[2] / "docs"
PAGE = DOCS / "robots.md"
FILES = Library([data_directory("robots")]).layers()[0]
MOST_BYTES = 1.5e6
"""Of all pictures together."""


def sections(page: Path) -> dict[str, str]:
    """Texts below the headings of classes, by class."""
    parts = re.split(r"^## (.+)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def test_the_page_lists_every_shipped_class() -> None:
    """A section and a row of the table for each, and for nothing else; if not, make it anew."""
    names = sorted(file.description.name for file in FILES)
    assert sorted(sections(PAGE)) == names, "usarsim robots --page docs/robots.md"
    rows = re.findall(r"^\| \[(\w+)\]\(#(\w+)\)", PAGE.read_text(), re.MULTILINE)
    assert sorted(name for name, _ in rows) == names
    assert all(anchor == name.lower() for name, anchor in rows)


def test_the_page_names_what_robots_carry_and_are_called() -> None:
    """Aliases, kinds, sensors, cameras and packages of every shipped class stand on the page."""
    found = sections(PAGE)
    for file in FILES:
        robot, text = file.description, found[file.description.name]
        assert f"`{robot.kind}`" in text, robot.name
        for alias in (*file.aliases, *file.alias_patterns, *file.exact_aliases):
            assert f"`{alias}`" in text, robot.name
        for item in robot.items:
            assert item.type in text, robot.name
        for actuator in robot.actuators:
            assert not actuator.package or f"`{actuator.name}`" in text, robot.name


def test_every_visible_class_has_a_small_picture() -> None:
    """All pictures of the page exist, are 240 x 180, show something and weigh little together."""
    shown = re.findall(r"!\[(\w+)\]\((\S+)\)", PAGE.read_text())
    invisible = {"MultiView", "ReferenceGPSCoordinate"}
    assert {name for name, _ in shown} == {file.description.name for file in FILES} - invisible
    total = 0
    for name, target in shown:
        picture = DOCS / target
        assert picture.stem == name
        image = Image.open(picture)
        assert image.size == (240, 180)
        assert len(image.convert("RGB").getcolors(240 * 180) or ()) > 10, name
        total += picture.stat().st_size
    assert total < MOST_BYTES


ROVER = """# A rover for tests.
#
# Frame of this file: x forward, y right, z down; metres, radians, kilograms. The rest is
# a starting value.

description = "the P3AT_real, but slower"
extends = "P3AT_real"
aliases = ["Slowpoke"]

[drive]
max_wheel_speed = 1.0
"""


def test_a_page_is_written_with_robots_of_further_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A section with picture, head comment, aliases, and figures as measured (1 rad/s, 0.11 m)."""
    folder = tmp_path / "robots"
    folder.mkdir()
    (folder / "Rover.toml").write_text(ROVER)
    everything = robot_page.read_files
    monkeypatch.setattr(
        robot_page,
        "read_files",
        lambda folders: [
            file for file in everything(folders) if file.description.name in ("Rover", "MultiView")
        ],
    )
    page = tmp_path / "docs" / "all.md"
    assert write(page, [folder]) == 0
    found = sections(page)
    assert set(found) == {"Rover", "MultiView"}
    text = found["Rover"]
    assert "A rover for tests." in text
    assert "The rest is a starting value." in text
    assert "Frame" not in text
    assert "| Also called | `Slowpoke` |" in text
    assert "| Top speed | 0.11 m/s |" in text
    assert "| Mass | 12 kg |" in text
    assert "`F1` ... `R8` (16)" in text
    assert Image.open(page.parent / "images" / "robots" / "Rover.png").size == (240, 180)
    assert "![" not in found["MultiView"], "there is nothing to be seen of it"
    assert capsys.readouterr().err.split() == ["MultiView", "Rover"]


def test_a_page_that_cannot_be_written_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, exit code 2."""
    (tmp_path / "file").write_text("")
    assert main(["robots", "--page", str(tmp_path / "file" / "robots.md")]) == 2
    errors = capsys.readouterr().err
    assert errors.startswith("error: ")
    assert errors.count("\n") == 1


def test_head_comments_are_read_up_to_the_first_line_that_is_none(tmp_path: Path) -> None:
    """Marks and the frame are left out, paragraphs stay apart."""
    path = tmp_path / "X.toml"
    path.write_text("# One\n# two.\n#\n# Three.\nname = 'X' # not this\n# nor this\n")
    assert head_comment(path) == "One two.\n\nThree."
