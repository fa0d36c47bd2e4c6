"""From a world folder to a MuJoCo specification."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest
from world_files import HEAD, SCENE, START, VICTIM, write_world

from usarsim_server.base.errors import WorldError
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene


def scene_of(directory: Path, scene: str = SCENE, sheet: str = HEAD + START) -> mujoco.MjSpec:
    """Build the scene of a world made of these texts."""
    return build_scene(load_world(write_world(directory, sheet, scene)))


def test_scenery_and_victims_come_together(tmp_path: Path) -> None:
    """The specification compiles and holds the scene's bodies and the victims."""
    model = scene_of(tmp_path, sheet=HEAD + START + VICTIM).compile()
    bodies = [model.body(body).name for body in range(model.nbody)]
    assert bodies == ["world", "crate", "victim:V"]
    assert model.body("victim:V").pos == pytest.approx([1.0, 2.0, 0.12])


def test_every_call_gives_a_fresh_specification(tmp_path: Path) -> None:
    """What one caller adds does not reach the next."""
    world = load_world(write_world(tmp_path))
    build_scene(world).worldbody.add_body(name="robot")
    assert build_scene(world).body("robot") is None


def test_a_scene_without_light_is_given_one(tmp_path: Path) -> None:
    """Cameras are never in the dark; a scene with its own light is left alone."""
    dark = SCENE.replace('<light type="directional" dir="0 0 -1"/>', "")
    assert scene_of(tmp_path, dark).compile().nlight == 1
    lit = scene_of(tmp_path).compile()
    assert lit.nlight == 1
    assert lit.light_dir[0] == pytest.approx([0.0, 0.0, -1.0])


def test_a_scene_without_sky_is_given_one(tmp_path: Path) -> None:
    """Cameras never look into black nothing; a scene with its own sky is left alone."""
    bare = scene_of(tmp_path / "bare").compile()
    assert bare.ntex == 1
    assert bare.tex_type[0] == mujoco.mjtTexture.mjTEXTURE_SKYBOX
    sky = (
        '<asset><texture name="own" type="skybox" builtin="flat" rgb1="1 0 0" width="8" '
        'height="48"/></asset><worldbody>'
    )
    own = scene_of(tmp_path / "own", SCENE.replace("<worldbody>", sky)).compile()
    assert [own.tex(number).name for number in range(own.ntex)] == ["own"]


def test_far_away_bodies_do_not_change_the_extent(tmp_path: Path) -> None:
    """Robots parked far away leave clip planes and shadows as they were."""
    spec = scene_of(tmp_path)
    before = spec.compile().stat
    extent, center = before.extent, before.center.copy()
    far = spec.worldbody.add_body(name="parked", pos=[0.0, 0.0, 2000.0])
    far.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[50.0, 50.0, 0.5])
    after = spec.compile().stat
    assert after.extent == extent < 10.0
    assert after.center == pytest.approx(center)


SCENE_MISTAKES = [
    ('<mujoco>\n<worldbody>\n<geom siz="1"/>\n</worldbody></mujoco>', "line 3", "'siz'"),
    ('<mujoco>\n<worldbody>\n<geom size="-1"/>\n</worldbody></mujoco>', "line 3", "positive"),
    ("<mujoco>\n<worldbody>\n", "line ", "XML parse error"),
    ("", "ParseXML", "empty file"),
    (
        '<mujoco>\n<worldbody>\n\n<geom class="no" size="1"/></worldbody></mujoco>',
        "line 4",
        "'no'",
    ),
    (
        '<mujoco><asset><mesh name="m" file="no.obj"/></asset>'
        '<worldbody><geom type="mesh" mesh="m"/></worldbody></mujoco>',
        "",
        "no.obj",
    ),
    ('<mujoco>\n\n<option timestep="0.001"/></mujoco>', "line 3", "`timestep`"),
    ('<mujoco>\n<option cone="elliptic"/></mujoco>', "line 2", "`cone`"),
    ('<mujoco>\n<option gravity="0 0 -1"/></mujoco>', "line 2", "`gravity`"),
    (
        '<mujoco><option>\n<flag gravity="disable"/></option></mujoco>',
        "line 1",
        "`disableflags`",
    ),
    (
        '<mujoco><worldbody><body name="b"><freejoint/><geom size="1"/></body></worldbody>\n'
        "<keyframe><key/></keyframe></mujoco>",
        "line 2",
        "keyframe",
    ),
    (
        '<mujoco><worldbody>\n<body><freejoint/><geom size="1"/></body></worldbody></mujoco>',
        "line 2",
        "has no name",
    ),
    ('<mujoco><worldbody><body name="victim:V"/></worldbody></mujoco>', "", "repeated name"),
]


@pytest.mark.parametrize(("scene", "where", "problem"), SCENE_MISTAKES)
def test_a_bad_scene_is_refused_with_file_and_line(
    tmp_path: Path, scene: str, where: str, problem: str
) -> None:
    """The error is one line: the file, the line as MuJoCo reports it, the problem, a cure."""
    folder = write_world(tmp_path, HEAD + START + VICTIM, scene)
    with pytest.raises(WorldError) as caught:
        build_scene(load_world(folder))
    text = str(caught.value)
    assert text.startswith(f"{folder.resolve() / 'scene.xml'}: {where}")
    assert problem in text
    assert "\n" not in text
    assert text.endswith(")")


def test_a_scene_may_include_other_files(tmp_path: Path) -> None:
    """Paths in a scene are relative to the world folder."""
    folder = write_world(
        tmp_path, scene='<mujoco><worldbody><include file="part.xml"/></worldbody></mujoco>'
    )
    (folder / "part.xml").write_text(
        '<mujocoinclude><geom name="included" size="1"/></mujocoinclude>', encoding="utf-8"
    )
    assert build_scene(load_world(folder)).geom("included") is not None
