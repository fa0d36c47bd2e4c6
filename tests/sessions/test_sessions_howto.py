"""docs/world-controller.md, done as written."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path

import pytest

from usarsim_server.base.files import data_directory
from usarsim_server.sessions.world_controller import WorldController
from usarsim_server.testing import Rehearsal
from usarsim_server.worlds.objects.bodies import SHAPES, load_objects

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "world-controller.md").read_text("utf-8")
BLOCKS = re.findall(r"```(\w*)\n(.*?)```", PAGE, re.DOTALL)
SHIPPED = load_objects([data_directory("worlds") / "objects.toml"])


def test_the_session_gives_the_answer() -> None:
    """The commands of the first example give exactly the line of the second."""
    (_, commands), (_, answer) = BLOCKS[:2]
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send(*commands.strip().splitlines())
        assert client.take() == [answer.strip()]


def test_the_table_names_every_type() -> None:
    """Every CONTROL type that is understood has its row, and no other."""
    rows = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|", PAGE, re.MULTILINE)
    types = {name.lower() for row in rows for name in re.findall(r"`([A-Z]\w+)`", row)}
    known = set(re.findall(r'"(\w+)": self\._', Path(_source()).read_text("utf-8")))
    assert types - {"none", "rigidbody", "falling", "ground"} == known


def _source() -> str:
    code = WorldController.__init__.__code__
    return code.co_filename


@pytest.mark.parametrize("name", re.findall(r"Shipped are, among others, (.*?)\.", PAGE, re.S)[:1])
def test_named_classes_are_shipped(name: str) -> None:
    """All classes that the page names exist."""
    words = [word for word in re.findall(r"[A-Za-z]+", name) if word[0].isupper() or "part" in word]
    named = [word for word in words if word not in ("USARPhysObj",)]
    assert len(named) > 20
    assert [word for word in named if SHIPPED.find(word) is None] == []


def test_the_example_of_a_class(tmp_path: Path) -> None:
    """A world with the objects.toml of the page has the class and the material."""
    text = next(block for language, block in BLOCKS if language == "toml")
    folder = tmp_path / "mine"
    shutil.copytree(data_directory("worlds") / "empty", folder)
    (folder / "objects.toml").write_text(text, encoding="utf-8")
    assert tomllib.loads(text)
    with Rehearsal(world=str(folder)) as stage:
        client = stage.connect()
        client.send(
            "INIT {ClassName USARBot.WorldController}",
            "CONTROL {Type Create} {ClassName Locker} {Name L} {Location 0,0,-0.315} "
            "{Material Chrome} {Physics RigidBody}",
            "CONTROL {Type GetSTA} {ClassName Cupboard}",
        )
        assert "{Size 0.4000,0.8000,0.6300}" in client.take()[0]


def test_all_shapes_are_named() -> None:
    """The page knows every shape that the reader knows."""
    assert all(f"`{shape}`" in PAGE for shape in SHAPES)


def test_the_walk() -> None:
    """The example of an avatar ends where it says."""
    commands = BLOCKS[-1][1].strip().splitlines()
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send(*commands)
        stage.run(6.0)
        last = client.take("STA")[-1]
    assert "{Location 4.00,3.00," in last
    assert last.endswith("{Walking False}")
