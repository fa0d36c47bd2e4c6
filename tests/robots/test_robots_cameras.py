"""Cameras in robot files: what is read, what is refused, what is inherited, what is shipped."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from robot_files import LEFT, RIGHT, table, write
from sharing import shipped_robots
from test_robots_files_fuzz import QUICK, check, values
from test_robots_limbs import ARM

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.description import CameraDescription, RobotDescription
from usarsim_server.simulation.frames import Pose

CAMERA: dict[str, Any] = {"name": "Camera", "position": [0.1, 0.05, -0.4]}
PAGE = Path(__file__).parents[2] / "docs" / "robot-files.md"


def load(folder: Path, *cameras: dict[str, Any], **changes: Any) -> RobotDescription:
    """Load the small test robot with cameras and changes."""
    return load_robot(write(folder, "Test", table(camera=list(cameras), **changes)))


def heir(folder: Path, **tables: Any) -> RobotDescription:
    """Load a robot that extends the one of `load`."""
    return load_robot(write(folder, "Heir", {"extends": "Test", **tables}))


def names(robot: RobotDescription) -> list[str]:
    """Names of the cameras, in mount order."""
    return [camera.name for camera in robot.cameras]


def test_defaults_are_those_of_the_original(tmp_path: Path) -> None:
    """Field of view 1.3963 rad, zoom from 0.3491 to 2.0944 rad (robots 101)."""
    (camera,) = load(tmp_path, CAMERA).cameras
    where = f"{tmp_path / 'Test.toml'}: [[camera]] 1 (Camera)"
    pose = Pose((0.1, -0.05, 0.4))
    assert camera == CameraDescription("Camera", None, pose, 1.3963, 0.3491, 2.0944, None, where)


def test_a_camera_is_no_streaming_item(tmp_path: Path) -> None:
    """Cameras send nothing on the control port, so they are no items."""
    assert [item.name for item in load(tmp_path, CAMERA).items] == ["F1"]


def test_everything_can_be_said(tmp_path: Path) -> None:
    """All keys arrive; a link is named in any case and remembered as it is spelled."""
    said = {**CAMERA, "link": "arm_link2", "rotation": [0, 0.5, 0], "type": "Camera"}
    lens = {"fov": 0.9, "min_fov": 0.2, "max_fov": 1.0, "rate": 30}
    (camera,) = load(tmp_path, {**said, **lens}, actuator=[ARM]).cameras
    assert camera.link == "Arm_Link2"
    assert (camera.fov, camera.min_fov, camera.max_fov, camera.rate) == (0.9, 0.2, 1.0, 30.0)
    # Pitch on the wire is nose up where z points down.
    assert camera.pose.rotate((1.0, 0.0, 0.0))[2] == pytest.approx(math.sin(0.5))


def test_a_picture_may_have_a_size_of_its_own(tmp_path: Path) -> None:
    """Two whole numbers of pixels; without them the tile's."""
    (camera,) = load(tmp_path, {**CAMERA, "size": [176, 144]}).cameras
    assert camera.size == (176, 144)
    for size in ([176], [176.5, 144], [0, 144], "small"):
        with pytest.raises(RobotDescriptionError, match="size"):
            load(tmp_path, {**CAMERA, "size": size})


def test_default_view_stays_within_the_zoom(tmp_path: Path) -> None:
    """A zoom range that leaves out the usual field of view makes its nearest end the default."""
    narrow, wide = {"name": "N", "max_fov": 0.5}, {"name": "W", "min_fov": 2.5}
    robot = load(tmp_path, narrow, wide)
    assert [camera.fov for camera in robot.cameras] == [0.5, 2.5]
    assert robot.cameras[1].max_fov == 2.5


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"position": [0, 0]}, r"position: \[0, 0\] is not 3 numbers"),
        ({"name": "two words"}, r"name: is 'two words'"),
        ({"name": None}, r"name: is missing"),
        ({"link": "Arm"}, r"link: no link 'Arm'"),
        ({"type": "Kamera"}, r"type: 'Kamera'"),
        ({"fov": 2.5}, r"fov: 2.5 .*from 0.3491 to 2.0944"),
        ({"min_fov": 1.0, "max_fov": 0.5}, r"max_fov: 0.5 .*a number from 1 to 3"),
        ({"max_fov": 3.2}, r"max_fov: 3.2"),
        ({"min_fov": 0}, r"min_fov: 0 "),
        ({"rate": 0}, r"rate: 0 "),
        ({"rate": 61}, r"rate: 61 .*from 0.1 to 60"),
        ({"interval": 0.1}, r"interval: unknown key \(write rate = pictures per second\)"),
        ({"zoom": 1}, r"zoom: unknown key"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    """Every mistake names file, table, key and cure."""
    camera = {key: value for key, value in {**CAMERA, **changes}.items() if value is not None}
    with pytest.raises(RobotDescriptionError, match=r"Test\.toml: \[\[camera\]\] 1.*" + said):
        load(tmp_path, camera)


def test_two_cameras_of_one_name_are_refused(tmp_path: Path) -> None:
    """Clients could not tell them apart."""
    with pytest.raises(RobotDescriptionError, match="a second camera is called 'CAMERA'"):
        load(tmp_path, CAMERA, {"name": "CAMERA"})


def test_cameras_are_inherited(tmp_path: Path) -> None:
    """An heir keeps cameras, replaces those of the same name in place, and adds others behind."""
    load(tmp_path, CAMERA, {"name": "Rear"})
    robot = heir(tmp_path, camera=[{"name": "Top"}, {"name": "camera", "fov": 1.0}])
    assert names(robot) == ["camera", "Rear", "Top"]
    assert robot.cameras[0].fov == 1.0
    assert robot.model == "Test"


def test_inherited_cameras_can_be_dropped(tmp_path: Path) -> None:
    """`without` takes cameras, and its error offers their names."""
    load(tmp_path, CAMERA, {"name": "Rear"})
    assert names(heir(tmp_path, without=["Camera"])) == ["Rear"]
    with pytest.raises(RobotDescriptionError, match="did you mean 'Rear'"):
        heir(tmp_path, without=["Reer"])


def test_carrier_of_an_inherited_camera_must_stay(tmp_path: Path) -> None:
    """A camera on a link that the heir no longer has is an error, unless it goes along."""
    load(tmp_path, {**CAMERA, "link": "LeftWheel"})
    wheels = [{**LEFT, "name": "Other"}, RIGHT]
    with pytest.raises(RobotDescriptionError, match="'Camera' sits on 'LeftWheel', which is gone"):
        heir(tmp_path, wheel=wheels)
    assert names(heir(tmp_path, wheel=wheels, without=["Camera"])) == []


def test_shipped_cameras() -> None:
    """Pioneers carry one camera, the stereo pair two, the omnidirectional ones a wide one too."""
    catalog = shipped_robots()
    found = {robot.name: robot for robot in catalog.descriptions()}
    for name in ("P2AT", "P2AT_ATLANTA", "RescueP2AT", "P2DX", "P3DX", "P3AT", "P3AT_arm"):
        assert names(found[name]) == ["Camera"]
    assert names(found["StereoP2AT"]) == ["LeftCamera", "RightCamera"]
    left, right = found["StereoP2AT"].cameras
    assert left.pose.position[1] == -right.pose.position[1] > 0.0
    for name in ("OmniP2AT", "OmniP2DX"):
        assert names(found[name]) == ["Camera", "OmniCamera"]
        assert found[name].cameras[1].fov == found[name].cameras[1].max_fov == 2.0944
    assert found["P2AT"].cameras[0].link == "CameraPanTilt_Link2"
    assert found["P3AT"].cameras[0].pose == Pose((0.1005, 0.0, 0.42))
    assert {camera.fov for camera in found["pioneer3at_with_sensors"].cameras} == {1.047}
    assert names(found["KR60"]) == []


def test_page_lists_exactly_the_known_keys(tmp_path: Path) -> None:
    """The table about cameras in the howto has exactly the keys that the loader knows."""
    with pytest.raises(RobotDescriptionError, match="zzzzzzzz") as caught:
        load(tmp_path, {**CAMERA, "zzzzzzzz": 1})
    known = set(str(caught.value).split("known keys: ")[1].rstrip(")").split(", "))
    text = PAGE.read_text(encoding="utf-8").split("### `[[camera]]`", 1)[1].split("\n#", 1)[0]
    rows = [line.split("|")[1] for line in text.splitlines() if line.startswith("| `")]
    assert {key.strip(" `") for row in rows for key in row.split(",")} == known


@QUICK
@given(
    st.dictionaries(
        st.sampled_from([*CAMERA, "link", "rotation", "fov", "min_fov", "max_fov", "rate", "type"]),
        values,
        max_size=4,
    )
)
def test_damaged_cameras_never_raise_anything_else(changes: dict[str, Any]) -> None:
    """Whatever a file says of a camera: a robot that can be built, or a RobotDescriptionError."""
    check({**copy.deepcopy(table()), "camera": [{**CAMERA, **changes}]})
