"""Symbolic links in folders that others made lead nowhere outside."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from usarsim_batch.errors import BatchError
from usarsim_batch.folder import Folder
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.reporting.runs import read as read_runs
from usarsim_exploration.run_folder import load_run
from usarsim_mission.errors import RunLogError
from usarsim_mission.match.archive import write_archive
from usarsim_mission.runlog import RunFolder
from usarsim_server.base.errors import UsarsimError, WorldError
from usarsim_server.base.files import check_links, data_directory
from usarsim_server.cli import main
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene
from usarsim_study.synthetic import Plan, make_study

TOLD = "is a link that leads out of its folder"


@pytest.fixture
def world(tmp_path: Path) -> Path:
    """A world folder, and beside it a file that is none of its business."""
    shutil.copytree(data_directory("worlds") / "empty", tmp_path / "yard")
    (tmp_path / "secret.xml").write_text("<mujoco><worldbody/></mujoco>")
    return tmp_path / "yard"


def test_a_scene_is_no_link_to_elsewhere(world: Path) -> None:
    """Refused by its name; allowed if the user says so; a link within the folder is a file."""
    (world / "scene.xml").rename(world / "real.xml")
    (world / "scene.xml").symlink_to("real.xml")
    build_scene(load_world(world))
    (world / "scene.xml").unlink()
    (world / "scene.xml").symlink_to("../secret.xml")
    with pytest.raises(WorldError, match=rf"scene\.xml: {TOLD} \(copy it .*--allow-outside\)"):
        build_scene(load_world(world))
    build_scene(load_world(world), allow_outside=True)


def test_a_scene_names_no_file_elsewhere(world: Path) -> None:
    """The same rule for what is written in it, links on the way included."""
    scene = world / "scene.xml"
    text = scene.read_text(encoding="utf-8")
    (world / "link").symlink_to("..")
    for name in ("../secret.xml", "link/secret.xml", str(world.parent / "secret.xml")):
        end = text.rindex("</mujoco>")
        scene.write_text(f'{text[:end]}<include file="{name}"/>{text[end:]}', encoding="utf-8")
        with pytest.raises(WorldError, match="lies outside the given folders"):
            build_scene(load_world(world))


def test_the_facts_of_a_world_are_no_link_to_elsewhere(world: Path) -> None:
    """`world.toml` belongs to its folder."""
    (world / "world.toml").rename(world.parent / "facts.toml")
    (world / "world.toml").symlink_to(world.parent / "facts.toml")
    with pytest.raises(WorldError, match=TOLD):
        load_world(world)


@pytest.mark.parametrize("name", ["truth.jsonl", "world.json", "handed-in/list_victim.txt"])
def test_runs_of_missions(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No command reads a link out of the folder of a run, nor packs it into an archive."""
    run = tmp_path / "run"
    (run / "handed-in").mkdir(parents=True)
    (run / "events.jsonl").write_text("")
    (tmp_path / "secret").write_text("secret")
    RunFolder(run)
    (run / name).symlink_to(tmp_path / "secret")
    with pytest.raises(RunLogError, match=rf"{name}: {TOLD}"):
        RunFolder(run)
    with pytest.raises(RunLogError, match=TOLD):
        write_archive(run)
    for command in (["mission", "score"], ["mission", "replay"]):
        assert main([*command, str(run)]) == 2
        assert TOLD in capsys.readouterr().err


def test_runs_of_explorations(tmp_path: Path) -> None:
    """Likewise."""
    run = tmp_path / "run"
    run.mkdir()
    (tmp_path / "secret").write_text('[strategy]\nname = "frontier"\n')
    (run / "scenario.toml").symlink_to(tmp_path / "secret")
    for read in (lambda: load_run(run, code=False), lambda: read_runs([run])):
        with pytest.raises(ExplorationError, match=rf"scenario\.toml: {TOLD}"):
            read()


def test_folders_of_batches(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Neither those that are compared nor those in which a batch goes on."""
    (tmp_path / "sent" / "runs").mkdir(parents=True)
    (tmp_path / "secret").write_text('{"row": {"secret": 1}, "timing": {}}')
    (tmp_path / "sent" / "runs" / "a.json").symlink_to(tmp_path / "secret")
    assert main(["sweep", "diff", *[str(tmp_path / "sent")] * 2]) == 2
    assert rf"a.json: {TOLD}" in capsys.readouterr().err
    with pytest.raises(BatchError, match=rf"a\.json: {TOLD}"):
        Folder(tmp_path / "sent", "test/1", {})


@pytest.mark.parametrize("command", ["report", "export", "forget"])
def test_folders_of_studies(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing outside is told, and nothing outside is removed with a participant."""
    folder = make_study(tmp_path / "study", Plan(4))
    one = folder.participants()[0]
    place = folder.place(one.code)
    place.rename(tmp_path / "elsewhere")
    place.symlink_to(tmp_path / "elsewhere")
    kept = sorted((tmp_path / "elsewhere").rglob("*"))
    code = [one.code] if command == "forget" else []
    assert main(["study", command, str(tmp_path / "study"), *code]) == 2
    assert f"{one.code}: {TOLD}" in capsys.readouterr().err
    assert sorted((tmp_path / "elsewhere").rglob("*")) == kept


def test_links_within_a_folder_are_let_be(tmp_path: Path) -> None:
    """Also in a folder that is reached by a link itself."""
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "a").write_text("a")
    (tmp_path / "real" / "b").symlink_to("a")
    (tmp_path / "run").symlink_to("real")
    check_links(tmp_path / "run", UsarsimError)
