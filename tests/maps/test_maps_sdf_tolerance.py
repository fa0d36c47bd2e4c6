"""One bad number does not refuse a Gazebo world; what is left out is named with its line."""

from __future__ import annotations

from pathlib import Path

import pytest
from mesh_samples import WEDGE, dae, dae_wedge, refusal, told, whole
from sdf_samples import BOX, load, model, only, shape, world, write

from usarsim_maps.convert import Request, import_map
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Box, Sphere
from usarsim_server.simulation.frames import rpy_from_quaternion

UNIT_BOX = "<box><size>1 1 1</size></box>"


def placed(text: str) -> str:
    """A model with a pose."""
    return model("m", BOX).replace("<static>", f"<pose>{text}</pose><static>")


@pytest.mark.parametrize(
    ("text", "place", "yaw", "note"),
    [
        ("1 2 3 0 0 1 7", (1, 2, 3), 1.0, "of the 7 numbers"),
        ("1 2 3 0 0 -3.14/2", (1, 2, 3), -1.57, ""),
        ("1 2 3 0 0 3.14 / 2", (1, 2, 3), 1.57, ""),
        ("1, 2, 3, 0, 0, 1", (1, 2, 3), 1.0, ""),
        ("1,5 2 3 0 0 0,25", (1.5, 2, 3), 0.25, ""),
        ("1 2 3 4", (1, 2, 3), 0.0, "of the 4 numbers"),
        ("1 2", (0, 0, 0), 0.0, "too few numbers; left out"),
        ("1 2 nan 0 0 0", (0, 0, 0), 0.0, "number without meaning; left out"),
        ("1 2 -nan(ind) 0 0 0", (0, 0, 0), 0.0, "number without meaning; left out"),
        ("1 2 1e30 0 0 0", (0, 0, 0), 0.0, "number without meaning; left out"),
        ("here", (0, 0, 0), 0.0, "'here' is no number; this <pose> was left out"),
    ],
)
def test_poses(tmp_path: Path, text: str, place: tuple[float, ...], yaw: float, note: str) -> None:
    """Six of seven numbers count, sums are done; the rest is SDF's default, nothing moves."""
    findings = Findings()
    thing = only(load(tmp_path, placed(text), findings))
    assert thing.pose.position == pytest.approx(place)
    assert rpy_from_quaternion(thing.pose.quaternion)[2] == pytest.approx(yaw)
    assert note in told(findings)
    assert bool(note) == bool(findings.warnings())
    assert not note or "map.world: line 4: " in told(findings)


@pytest.mark.parametrize(
    "text",
    [
        shape("<sphere/>"),
        shape("<sphere><radius>big</radius></sphere>"),
        shape("<box><size>1 nan 3</size></box>"),
        shape("<box><size>1 2</size></box>"),
        shape("<cylinder><radius>1</radius><length>1.#IND</length></cylinder>"),
    ],
)
def test_sizes(tmp_path: Path, text: str, findings: Findings) -> None:
    """A shape whose size makes no sense is left out, the others of its model are there."""
    other = shape("<sphere><radius>1</radius></sphere>").replace('"v"', '"w"')
    thing = only(load(tmp_path, model("m", text + other), findings))
    assert [part.shape for part in thing.parts] == [Sphere(1.0)]
    assert "left out" in told(findings)


def test_sizes_that_can_be_read(tmp_path: Path) -> None:
    """Too many numbers, sums and decimal commas are no obstacle."""
    for size in ("1 2 3 4", "2/2 1+1 3", "1,0 2,0 3,0"):
        inner = model("m", shape(f"<box><size>{size}</size></box>"))
        assert only(load(tmp_path, inner)).parts[0].shape == Box((1.0, 2.0, 3.0))


def test_scales_and_outlines(tmp_path: Path, findings: Findings) -> None:
    """A bad scale of a mesh is 1; a bad corner of an outline is left out."""
    write(tmp_path, dae(dae_wedge()), "w.dae")
    mesh = "<mesh><uri>w.dae</uri><scale>2 x 2</scale></mesh>"
    high = whole(load(tmp_path, model("m", shape(mesh)), findings)).vertices.max(axis=0)
    assert high == pytest.approx(WEDGE.max(axis=0))
    points = "".join(f"<point>{p}</point>" for p in ("0 0", "1 0", "1 y", "0 1"))
    outline = f"<polyline><height>z</height>{points}</polyline>"
    prism = whole(load(tmp_path, model("m", shape(outline)), findings))
    assert prism.vertices.max(axis=0) == pytest.approx([1.0, 1.0, 1.0])
    assert told(findings).count("left out") >= 3


@pytest.mark.parametrize("value", ["nan", "heavy", "-1", "1e99", ""])
def test_masses(tmp_path: Path, value: str) -> None:
    """A mass that makes no sense counts as none."""
    inertial = f"<inertial><mass>{value}</mass></inertial>"
    assert only(load(tmp_path, model("m", inertial + BOX, static=False))).mass is None


def test_friction_colour_and_transparency(tmp_path: Path, findings: Findings) -> None:
    """So do friction, colour and transparency."""
    more = "<material><diffuse>red</diffuse></material><transparency>yes</transparency>"
    text = shape(UNIT_BOX, more=more).replace(
        "</collision>",
        "<surface><friction><ode><mu>high</mu></ode></friction></surface></collision>",
    )
    thing = only(load(tmp_path, model("m", text), findings))
    assert thing.friction is None
    assert not thing.parts[0].materials
    for tag in ("diffuse", "transparency", "mu"):
        assert f"this <{tag}> was left out" in told(findings)


def test_lights(tmp_path: Path, findings: Findings) -> None:
    """A light is what is left of it."""
    text = (
        '<light name="L" type="spot"><pose>1 2 3 0 0 0</pose><diffuse>nan 1 1 1</diffuse>'
        "<direction>0 0 nan</direction><attenuation><range>far</range></attenuation>"
        "<spot><outer_angle>x</outer_angle></spot><intensity>inf</intensity></light>"
    )
    (light,) = load(tmp_path, text + model("m", BOX), findings).lights
    assert (light.position, light.direction) == ((1.0, 2.0, 3.0), (0.0, 0.0, -1.0))
    assert (light.color, light.brightness, light.reach) == ((1.0, 1.0, 1.0), 1.0, 0.0)
    assert light.cone == pytest.approx(45.0)
    assert len(findings.warnings()) == 5


def test_start_poses(tmp_path: Path, findings: Findings) -> None:
    """So do those of start poses: sums are done, the first six of seven numbers count."""
    plugin = (
        '<plugin name="p" filename="x"><StartPose_1>A 1,2,0.3 0,0,-3.14/2 9</StartPose_1>'
        "<StartPose_2>B 1,2,x</StartPose_2></plugin>"
    )
    (start_pose,) = load(tmp_path, plugin + model("m", BOX), findings).starts
    assert start_pose.pose.position == (1.0, 2.0, 0.3)
    assert rpy_from_quaternion(start_pose.pose.quaternion)[2] == pytest.approx(-1.57)
    assert "'B 1,2,x' is no start pose" in told(findings)


def test_gravity_and_saved_poses(tmp_path: Path, findings: Findings) -> None:
    """A saved pose that makes no sense leaves the model where it was."""
    state = (
        '<state world_name="d"><model name="m"><pose>1 2 x 0 0 0</pose></model></state>'
        "<gravity>down</gravity>"
    )
    thing = only(load(tmp_path, placed("4 5 6 0 0 0") + state, findings))
    assert thing.pose.position == (4.0, 5.0, 6.0)
    assert len(findings.warnings()) == 2


def test_a_world_of_bad_numbers_says_why_it_is_empty(tmp_path: Path) -> None:
    """Where nothing is left the error tells the first reason."""
    path = write(tmp_path, world(model("m", shape("<box><size>x</size></box>"))))
    message = refusal(lambda: import_map(Request(path)))
    assert "; map.world: line 4: 'x' is no number" in message
