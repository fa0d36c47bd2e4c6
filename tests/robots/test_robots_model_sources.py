"""Model files that are included, damaged, missing or too large: one clear error."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from model_texts import (
    LEG,
    TETRAHEDRON,
    body,
    mjcf,
    write_stl,
)
from robot_files import write

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.robots import model_sources
from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.mjcf import build_spec


def test_includes_and_defaults_work(tmp_path: Path) -> None:
    """An MJCF file may include others, as MuJoCo allows."""
    (tmp_path / "leg.xml").write_text(f"<mujoco>{LEG}</mujoco>")
    robot = body(tmp_path, mjcf('<include file="leg.xml"/>'))
    assert [link.joint for link in robot.links] == ["Hip", "Knee"]


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", "body.xml: MuJoCo cannot use it"),
        ("<mujoco", "body.xml: MuJoCo cannot use it"),
        ("just words", "body.xml: MuJoCo cannot use it"),
        ("<mujoco><worldbody/></mujoco>", "0 bodies stand in the world"),
        (b"\xff\xfe\x00<mujoco/>", "is in UTF-16"),
        (mjcf(world='<body><geom size="1"/></body>'), "2 bodies stand in the world"),
        (mjcf('<body><joint type="ball"/><geom size="0.1"/></body>'), "is a ball or free joint"),
        (mjcf("<body><freejoint/></body>"), "body.xml: MuJoCo cannot use it"),
        (
            mjcf().replace("<freejoint/>", '<joint axis="0 0 1"/>'),
            "root body 'Torso' has a joint of its own",
        ),
        (mjcf('<body><joint/><geom type="mesh" mesh="gone"/></body>'), "MuJoCo cannot use it"),
        (
            mjcf(before='<asset><mesh name="m" file="gone.stl"/></asset>'),
            "MuJoCo cannot use it: .*gone.stl",
        ),
        (mjcf('<body><joint/><geom size="0.1" mass="0"/></body>'), "MuJoCo cannot use it"),
        (mjcf(torso='<geom size="1" mass="1e6"/>'), "weighs 1e.06 kg"),
        (mjcf(LEG.replace('pos="0 0 -0.25"', 'pos="nan 0 0"')), "is not finite somewhere"),
        (
            mjcf(
                '<body><joint name="a-b"/><geom size="0.1"/></body>'
                '<body><joint name="A_b"/><geom size="0.1"/></body>'
            ),
            "two joints are called 'A_b'",
        ),
    ],
)
def test_bad_files_are_one_clear_error(tmp_path: Path, text: str | bytes, error: str) -> None:
    """A file that cannot be a body is one error that names it and what to do."""
    with pytest.raises(RobotDescriptionError, match=error) as caught:
        body(tmp_path, text)
    message = str(caught.value)
    assert "body.xml" in message
    assert message.endswith(")")
    assert "\n" not in message


def test_missing_files(tmp_path: Path) -> None:
    """A file that is not there, and a folder, are errors that name it."""
    robot = {"description": "x", "kind": "legged", "dialect": "udk"}
    for name in ("gone.xml", "."):
        with pytest.raises(RobotDescriptionError, match="cannot be read"):
            load_robot(write(tmp_path, "Walker", {**robot, "body": name}))


@pytest.mark.parametrize(
    ("limit", "value", "error"),
    [
        ("LARGEST_TEXT", 100, "it is larger than"),
        ("LARGEST_MESHES", 100, "its meshes are larger than"),
        ("MOST_TRIANGLES", 3, "has 4 triangles, at most 3"),
        ("MOST_BODIES", 2, "has 3 bodies, at most 2"),
    ],
)
def test_sizes_are_limited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, value: int, error: str
) -> None:
    """Files, meshes and trees beyond all reason are refused, not loaded for minutes."""
    write_stl(tmp_path / "tetra.stl", *TETRAHEDRON)
    shape = '<geom type="mesh" mesh="t"/>'
    inside = f"<body><joint/>{shape}</body>"
    text = mjcf(inside, before='<asset><mesh name="t" file="tetra.stl"/></asset>')
    body(tmp_path, text)
    monkeypatch.setattr(model_sources, limit, value)
    with pytest.raises(RobotDescriptionError, match=error):
        body(tmp_path, text)


@pytest.mark.parametrize(
    ("keys", "error"),
    [
        ({"joints": {"Hpi": {}}}, "Hpi: unknown key.*Hip"),
        ({"joints": {"Hip": {"speed": 1}}}, r"Hip: speed: unknown key"),
        ({"joints": {"Hip": {"limits": [1.0, -1.0]}}}, "are 1 and -1"),
        ({"joints": {"Hip": {"home": 9.0}}}, "home: 9"),
        ({"joints": {"Hip": {"limits": [0.5, 1.0], "home": 0.0}}}, "home: 0"),
        ({"joints": {"max_torque": 0}}, "max_torque: 0"),
        ({"joints": {"Hip": {"follows": "Elbow"}}}, "follows 'Elbow', which is not free"),
        (
            {"joints": {"Hip": {"follows": "Knee"}, "Knee": {"follows": "Hip"}}},
            "which is not free",
        ),
        ({"package": [{"name": "Leg", "joints": ["Elbow"]}]}, "no joint 'Elbow'"),
        ({"package": [{"name": "Leg"}]}, "names no joint"),
        ({"package": [{"joints": ["Hip"]}]}, "name: is missing"),
        ({"package": [{"name": "Leg 1", "joints": ["Hip"]}]}, "name: is 'Leg 1'"),
        ({"package": [{"name": "Joints", "joints": ["Hip"]}]}, "name: is 'Joints'"),
        ({"package": [{"name": "Leg", "joints": ["Hip", "Hip"]}]}, "in a package already"),
        ({"package": [{"name": "Leg", "joints": ["Hip"], "tip": 1}]}, "tip: unknown key"),
        ({"body": 5}, "body: 5 is not text"),
    ],
)
def test_bad_tables_are_one_clear_error(tmp_path: Path, keys: dict[str, Any], error: str) -> None:
    """A mistake in what is said about a model file names table, key and cure."""
    with pytest.raises(RobotDescriptionError, match=error) as caught:
        body(tmp_path, mjcf(), **keys)
    assert "Walker.toml" in str(caught.value)


@pytest.mark.parametrize("key", ["joints", "package"])
def test_tables_about_a_model_file_need_one(tmp_path: Path, key: str) -> None:
    """`[joints]` and `[[package]]` without `body` are a mistake."""
    value: object = {} if key == "joints" else [{"name": "A", "joints": ["B"]}]
    shape = {"kind": "box", "size": [0.1, 0.1, 0.1], "mass": 1.0}
    robot = {"kind": "legged", "dialect": "udk", "shape": [shape], key: value}
    with pytest.raises(RobotDescriptionError, match=f"{key}: is about a model file"):
        load_robot(write(tmp_path, "Walker", robot))


@settings(
    max_examples=60,
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.integers(0, len(mjcf()) - 1), st.sampled_from(['"', "<", ">", "x", "-", "1e9", "\0", ""]))
def test_damaged_files_never_raise_anything_else(tmp_path: Path, place: int, bit: str) -> None:
    """A file with one character changed is a robot that compiles, or one clear error."""
    text = mjcf()
    damaged = text[:place] + bit + text[place + 1 :]
    try:
        robot = body(tmp_path, damaged)
    except RobotDescriptionError:
        return
    assert math.isfinite(robot.report.mass)
    build_spec(robot).compile()
