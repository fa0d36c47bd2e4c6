"""The missions that come along can be done; their zones show in camera pictures."""

from __future__ import annotations

import colorsys
import os
import re
from pathlib import Path

import numpy as np
import pytest
from mission_worlds import ROBOT, VICTIM, write_mission
from PIL import Image

from usarsim_mission.scenario.check import findings
from usarsim_mission.scenario.reader import find_mission, read_scenario, shipped_missions
from usarsim_mission.scenario.resolving import stage
from usarsim_server.cli import main

MAP = "competition-map"
LEAGUE = Path(os.environ.get("USARSIM_MAPS", "")) / "gazebo" / "RC2016VRL_PreLiminary1.world"
HUES = {"orange": 30.0, "yellow": 53.0, "red": 0.0, "blue": 228.0}
"""degrees."""


@pytest.mark.parametrize("path", shipped_missions(), ids=lambda path: path.stem)
def test_shipped_missions_can_be_done(path: Path) -> None:
    """None of them has a finding, for other seeds either; that of a map needs the map."""
    scenario = read_scenario(path)
    if path.stem == MAP:
        assert scenario.world == "./RC2016VRL_PreLiminary1.world"
        return
    assert findings(stage(scenario)) == []


def test_they_are_varied(capsys: pytest.CaptureFixture[str]) -> None:
    """Six kinds in three worlds: search, mixed zones, scaling, radio, moving people, RSARSim."""
    scenarios = {path.stem: read_scenario(path) for path in shipped_missions()}
    worlds = {one.world for one in scenarios.values()}
    assert {"arena", "office", "plant"} <= worlds
    counts = [len(scenarios[f"scaling-{n}"].robots) for n in (4, 8, 12)]
    assert counts == [4, 8, 12]
    assert all(scenarios[f"scaling-{n}"].victims == scenarios["scaling-4"].victims for n in (8, 12))
    assert [one.kind for one in scenarios["rsarsim"].robots] == ["P3DX"] * 4
    assert {one.colour for one in scenarios["arena-zones"].zones} == {"yellow", "orange", "red"}
    assert scenarios["plant-radio"].radio
    explorers = [one for one in scenarios["plant-radio"].robots if one.unattended == "explore"]
    assert all(one.position and one.position[0] > -3.0 for one in explorers)  # no gate before them
    assert len(scenarios) == 10
    assert any(one.moves for one in scenarios["office-moving"].victims)
    assert main(["mission", "list"]) == 0
    assert "arena-search" in capsys.readouterr().out


def test_a_map_that_its_user_brings(tmp_path: Path) -> None:
    """`--world` names it: here a map of boxes in which robots and victims of the file fit."""
    boxes = "".join(
        f"<model name='b{n}'><static>true</static><pose>{x} {y} 0.5 0 0 0</pose><link name='l'>"
        "<collision name='c'><geometry><box><size>1 1 1</size></box></geometry></collision>"
        "<visual name='v'><geometry><box><size>1 1 1</size></box></geometry></visual></link>"
        "</model>"
        for n, (x, y) in enumerate([(5, 0), (-5, 3)])
    )
    ground = (
        "<model name='g'><static>true</static><link name='l'><collision name='c'><geometry><plane>"
        "<normal>0 0 1</normal><size>40 40</size></plane></geometry></collision></link></model>"
    )
    place = tmp_path / "yard.world"
    place.write_text(f"<sdf version='1.6'><world name='yard'>{ground}{boxes}</world></sdf>")
    robot = ROBOT.replace('start = "West"', "position = [0, 0, 0.25]")
    path = write_mission(tmp_path, robot, VICTIM)
    assert main(["mission", "check", str(path), "--world", str(place)]) == 0


@pytest.mark.skipif(not LEAGUE.is_file(), reason=f"USARSIM_MAPS has no gazebo/{LEAGUE.name}")
def test_the_map_of_the_league() -> None:
    """The mission in it can be done, where somebody has put the map."""
    staged = stage(read_scenario(find_mission(MAP)), world=str(LEAGUE))
    assert findings(staged) == []
    assert len(staged.victims) == 4
    assert any(zone.kind == "blue" for zone in staged.painted)


@pytest.mark.parametrize("colour", HUES)
def test_zones_show_in_pictures(tmp_path: Path, colour: str) -> None:
    """O-02: the camera of a robot inside a zone sees the zone's colour on the wall, and no other.

    The wall is grey, and so is the floor.
    """
    zone = f'[[zone]]\nname = "east"\ncolour = "{colour}"\nx = [0, 6]\ny = [-3, 3]\n'
    path = write_mission(tmp_path, "band = 0.0\n", ROBOT, VICTIM, zone)
    folder, picture = tmp_path / "world", tmp_path / "picture.png"
    assert main(["mission", "check", str(path), "--out", str(folder)]) == 0
    here = ["--robot", "P3AT_real@3.5,0,-0.2,0", "--view", "P3AT_real/Camera"]
    size = ["--size", "160x120", "--after", "0.1"]
    assert main(["snapshot", str(picture), "--world", str(folder), *here, *size]) == 0
    pixels = np.asarray(Image.open(picture).convert("RGB")).reshape(-1, 3) / 255.0
    found = np.array([colorsys.rgb_to_hsv(*pixel) for pixel in pixels])
    vivid = found[(found[:, 1] > 0.6) & (found[:, 2] > 0.3)]
    assert len(vivid) > 200
    off = np.abs((vivid[:, 0] * 360.0 - HUES[colour] + 180.0) % 360.0 - 180.0)
    assert np.mean(off < 12.0) > 0.95


def test_the_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """docs/missions.md: its scenario can be done, its command prints what is shown, and its table
    has every shipped mission."""
    page = (Path(__file__).parents[2] / "docs" / "missions.md").read_text(encoding="utf-8")
    example = next(
        text
        for text in re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
        if "usar-mission/1" in text
    )
    path = tmp_path / "example.toml"
    path.write_text(example, encoding="utf-8")
    assert findings(stage(read_scenario(path))) == []
    assert main(["mission", "check", "arena-search"]) == 0
    assert capsys.readouterr().out.strip() in page
    assert all(f"`{path.stem}`" in page for path in shipped_missions())
