"""Maps that robots cannot live in (worlds 71); damaged and huge ones: bounded memory and time."""

from __future__ import annotations

import logging
import tracemalloc
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
from built_worlds import build_world, cuboid_mesh, mesh_of, scene_of, thing
from gltf_samples import glb, gltf
from hypothesis import given
from hypothesis import strategies as st
from mesh_samples import (
    FACES,
    FUZZ,
    TRIANGLES,
    VERTEX,
    WEDGE,
    dae,
    dae_geometry,
    obj,
    read,
    told,
    upright,
    whole,
)
from sdf_samples import BOX, model, sdf, shape, world, write
from t3d_maps import actor, brush, cuboid, level, polygon, room, start, two_rooms
from udk_maps import box_triangles, static_mesh
from unreal_fixture import Writer

from usarsim_maps import convert
from usarsim_maps.build.csg import MAX_POLYGONS
from usarsim_maps.convert import Request, import_map
from usarsim_maps.findings import Findings
from usarsim_maps.reader import Context, ImportOptions, read_scene
from usarsim_maps.scene import Mesh, Scene
from usarsim_server.base.errors import MapImportError
from usarsim_server.cli import main
from usarsim_server.testing import Rehearsal
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene

WALLS = [(0, 0, 0), (4, 0, 0), (4, 0, 3), (0, 0, 3), (0, 4, 0), (4, 4, 0), (4, 4, 3), (0, 4, 3)]


def walls() -> Mesh:
    """Two upright rectangles."""
    return mesh_of(WALLS, [(0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6)])


def notes(findings: Findings, subject: str) -> list[str]:
    """What was said about something."""
    return [warning.text for warning in findings.warnings() if warning.subject == subject]


def test_starts_in_walls_and_below_floors(tmp_path: Path) -> None:
    """Each is named with what will happen and what to do; a good one is not.

    A robot that starts below the floor is put on it, beside the one that stands there.
    """
    source = tmp_path / "odd.t3d"
    places = [("InWall", (520, 0, 60)), ("Below", (0, 0, -40)), ("Good", (0, 0, 60))]
    starts = [start(f"PlayerStart_{n}", place, tag) for n, (tag, place) in enumerate(places)]
    source.write_text(level(room(), *starts))
    result = import_map(Request(source))
    told = {subject: text for subject, text, _ in result.report.warnings}
    for name in ("InWall", "Below"):
        assert "solid" in told[name]
        assert "sidecar" in told[name]
    assert "Good" not in told
    with Rehearsal(world=str(result.folder)) as rehearsal:
        alive, moved = rehearsal.connect(), rehearsal.connect()
        alive.send("INIT {ClassName USARBot.P2AT} {Name A} {Start Good}")
        moved.send("INIT {ClassName USARBot.P2AT} {Name B} {Start Below}")
        rehearsal.run(4.0)
        heights = []
        for client in (alive, moved):
            lines = client.take()
            assert not [line for line in lines if line.startswith("DIE")]
            line = [line for line in lines if "{Type GroundTruth}" in line][-1]
            heights.append(float(line.partition("{Location ")[2].partition("}")[0].split(",")[2]))
        assert heights[0] == pytest.approx(heights[1], abs=0.01)
        rehearsal.run(0.5)
        assert alive.take("STA"), "the other goes on"


def test_a_map_without_floor(tmp_path: Path, findings: Findings) -> None:
    """Walls alone can be imported, but the report says that robots will fall, and the cures."""
    world = build_world(tmp_path, scene_of(thing(walls(), "walls")), findings)
    (text,) = notes(findings, "level")
    assert "only 0 % of the map have a floor" in text
    assert "--up" in text
    with Rehearsal(world=str(world.built.folder)) as rehearsal:
        client = rehearsal.connect()
        client.send("INIT {ClassName USARBot.P2AT} {Location 2,-2,-1}")
        rehearsal.run(5.0)
        assert client.take("DIE {Killer None}")


def test_a_floor_is_not_complained_about(tmp_path: Path, findings: Findings) -> None:
    """With a floor under the same walls nothing is said."""
    floor = thing(cuboid_mesh((0, 0, -0.2), (4, 4, 0)), "floor")
    build_world(tmp_path, scene_of(thing(walls(), "walls"), floor), findings)
    assert not notes(findings, "level")


def square(folder: Path, size: float) -> Path:
    """A file with a level square."""
    source = folder / "odd.obj"
    corners = [(0, 0, 0), (size, 0, 0), (size, 0, -size), (0, 0, -size)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    source.write_text("\n".join([*lines, "f 1 2 3", "f 1 3 4"]) + "\n")
    return source


@pytest.mark.parametrize(("size", "cure"), [(30_000.0, "--scale 1000"), (3e-4, "--scale 0.00001")])
def test_absurd_sizes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], size: float, cure: str
) -> None:
    """A mesh a thousand times too large, or finer than dust: one line with a scale, code 2."""
    source = square(tmp_path, size)
    assert main(["import", str(source), "--out", str(tmp_path / "out")]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
    assert str(source) in line
    assert f"{size:g} x {size:g} x 0 m large" in line
    assert cure in line
    assert "e+" not in line
    assert not (tmp_path / "out" / "odd").exists()


def test_small_things(tmp_path: Path) -> None:
    """A mesh of 3 cm is a thing, or a map with a wrong scale: it is imported, and that is said."""
    report = import_map(Request(square(tmp_path, 0.03))).report
    assert report.extents == pytest.approx((0.03, 0.03, 0.0))
    (told,) = [text for subject, text, _ in report.warnings if subject == "odd.obj"]
    assert "--scale 0.001 " in told


def test_a_small_world_of_gazebo(tmp_path: Path) -> None:
    """Its unit is the metre, so a world may hold nothing but a cup, unless a user has a scale."""
    cup = model("cup", shape("<box><size>0.1 0.1 0.1</size></box>"))
    for text, name in ((sdf(cup), "cup.sdf"), (world(cup), "cup.world")):
        assert import_map(Request(write(tmp_path, text, name))).report.extents
    options = ImportOptions(scale=10.0)
    with pytest.raises(MapImportError, match="absurd"):
        import_map(Request(tmp_path / "cup.world", options=options))


def test_a_small_package(tmp_path: Path) -> None:
    """The meshes of a package may be small, the walls of a level may not."""
    meshes = Writer(flags=1)
    static_mesh(meshes, "Cup", box_triangles((0, 0, 0), (30, 30, 30)), group="Kitchen")
    (tmp_path / "Kitchen.upk").write_bytes(meshes.content())
    extents = import_map(Request(tmp_path / "Kitchen.upk")).report.extents
    assert extents == pytest.approx((0.12, 0.12, 0.12))
    (tmp_path / "map.t3d").write_text(level(brush("B", (0, 0, 0), (30, 30, 30))))
    with pytest.raises(MapImportError, match="absurd"):
        import_map(Request(tmp_path / "map.t3d"))


FAR_LINE = {
    "map.dae": dae(
        dae_geometry(
            f'{TRIANGLES}<lines count="1">{VERTEX}<p>4 5</p></lines>',
            "0 0 0 2 0 0 0 1 0 0 0 3 500 0 0 500 1 0",
        )
    ),
    "map.obj": "v 0 0 0\nv 2 0 0\nv 0 3 0\nv 0 0 -1\nv 500 0 0\nv 500 1 0\nf 1 2 3\nf 1 4 2\n"
    "f 1 3 4\nf 2 4 3\nl 5 6\nf 5 6 6\n",
    "map.ply": "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n"
    "property float z\nelement face 4\nproperty list uchar int vertex_indices\nelement edge 1\n"
    "property int vertex1\nproperty int vertex2\nend_header\n"
    "0 0 0\n2 0 0\n0 1 0\n0 0 3\n500 0 0\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n0 4\n",
}


@pytest.mark.parametrize("name", FAR_LINE)
def test_points_of_lines_have_no_size(tmp_path: Path, name: str) -> None:
    """What only lines use, and triangles without area, count neither in extents nor in bounds."""
    result = import_map(Request(write(tmp_path, FAR_LINE[name], name)))
    assert result.report.extents == pytest.approx((2.0, 1.0, 3.0))
    assert load_world(result.folder).upper[0] == pytest.approx(22.0)


def test_lines_of_gltf_and_spare_points_of_stages(tmp_path: Path) -> None:
    """The same where triangles and lines share their points."""
    points = np.concatenate([upright(WEDGE), [[500, 0, 0], [500, 1, 0]]]).astype("<f4").tobytes()
    corners = np.concatenate([FACES.ravel(), [4, 5]]).astype("<u2").tobytes()
    value = gltf()
    primitive = {"attributes": {"POSITION": 0}, "indices": 1}
    value["meshes"] = [{"primitives": [primitive, primitive | {"indices": 2, "mode": 1}]}]
    short = {"bufferView": 1, "componentType": 5123, "type": "SCALAR"}
    value["accessors"][0]["count"] = 6
    value["accessors"][1:] = [short | {"count": 12}, short | {"count": 2, "byteOffset": 24}]
    value["bufferViews"] = [
        {"buffer": 0, "byteLength": 72},
        {"buffer": 0, "byteOffset": 72, "byteLength": 28},
    ]
    text = glb(value, points + corners)
    report = import_map(Request(write(tmp_path, text, "map.glb"))).report
    assert report.extents == pytest.approx((2.0, 1.0, 3.0))
    pytest.importorskip("pxr", reason="usd-core is not installed: pip install usd-core")
    stage = (
        '#usda 1.0\n(\n upAxis = "Z"\n metersPerUnit = 1\n)\ndef Mesh "M"\n{\n'
        " point3f[] points = [(0,0,0),(4,0,0),(4,4,0),(0,4,0),(500,0,0)]\n"
        " int[] faceVertexCounts = [4]\n int[] faceVertexIndices = [0,1,2,3]\n}\n"
    )
    report = import_map(Request(write(tmp_path, stage, "map.usda"))).report
    assert report.extents == pytest.approx((4.0, 4.0, 0.0))


def test_extents_are_those_of_the_map(tmp_path: Path) -> None:
    """A start pose in the air is in the bounds, and adds nothing to the extents."""
    floor = model("floor", shape("<box><size>10 10 0.2</size></box>"))
    start_pose = '<plugin name="p" filename="x"><StartPose_1>A 0,0,1.5</StartPose_1></plugin>'
    result = import_map(Request(write(tmp_path, world(floor + start_pose))))
    assert result.report.extents == pytest.approx((10.0, 10.0, 0.2))
    assert load_world(result.folder).upper[2] == pytest.approx(101.5)


def test_planes_have_no_extents(tmp_path: Path) -> None:
    """Of a world of endless planes no size is told; robots may be where its plane is drawn."""
    source = write(tmp_path, world("<include><uri>model://ground_plane</uri></include>"))
    for _ in range(2):  # fresh, and remembered
        result = import_map(Request(source))
        assert result.report.extents is None
        assert "endless planes" in result.report.text()
    assert load_world(result.folder).lower[:2] == pytest.approx((-70.0, -70.0))


@pytest.mark.parametrize("place", ["5000 0 0 0 0 0", "1e8 1e8 0 0 0 0", "0 0 -99999 0 0 0"])
def test_misplaced_objects(tmp_path: Path, place: str) -> None:
    """One object of many that lies kilometres away is left out; half of them are believed.

    Unless a map would be larger than single precision can tell.
    """

    def text(near: int, far: int) -> str:
        cube = shape("<box><size>1 1 1</size></box>")
        poses = [f"{k} 0 0 0 0 0" for k in range(near)] + [place] * far
        boxes = [model(f"m{k}", cube).replace("<link", f"<pose>{pose}</pose><link")
                 for k, pose in enumerate(poses)]  # fmt: skip
        return world("".join(boxes))

    report = import_map(Request(write(tmp_path, text(9, 1)))).report
    assert report.extents == pytest.approx((9.0, 1.0, 1.0))
    assert ("m9", "an object far outside the map was left out", 1) in report.warnings
    source = write(tmp_path, text(5, 5))
    if place.startswith("5000"):
        report = import_map(Request(source)).report
        assert report.extents == pytest.approx((5001.0, 1.0, 1.0))
        assert any("are much" in told for _, told, _ in report.warnings)
    else:
        with pytest.raises(MapImportError, match="absurd"):
            import_map(Request(source))


def attempt(folder: Path, content: bytes) -> str:
    """Import some bytes as T3D; the world's name, or the error in one line."""
    source = folder / "fuzz.t3d"
    source.write_bytes(content)
    try:
        result = import_map(Request(source, cache=folder / "cache"))
    except MapImportError as error:
        told = str(error)
    else:
        build_scene(load_world(result.folder))
        return result.folder.name
    assert "\n" not in told
    assert str(folder) in told
    return told


@given(st.binary(max_size=400))
@FUZZ
def test_any_bytes(tmp_path: Path, content: bytes) -> None:
    """Bytes of any kind end in one error that names the file."""
    assert "fuzz.t3d" in attempt(tmp_path, content)


@given(st.data())
@FUZZ
def test_garbled_maps(tmp_path: Path, data: st.DataObject) -> None:
    """A good map with some bytes changed gives a world that loads, or one error (worlds 73)."""
    content = bytearray(two_rooms().encode())
    for _ in range(data.draw(st.integers(1, 6))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] = data.draw(st.sampled_from(b"\0\xff-e9(=\n "))
    assert attempt(tmp_path, bytes(content))


NASTY = st.sampled_from(
    ["1e999", "-1e999", "nan", "1e30", "0", "-0", "", "1e-300", "(((", "99999999999"]
)


@pytest.mark.slow
@given(st.tuples(NASTY, NASTY, NASTY), st.tuples(NASTY, NASTY, NASTY), NASTY)
@FUZZ
def test_senseless_numbers(
    tmp_path: Path, place: tuple[str, ...], scale: tuple[str, ...], number: str
) -> None:
    """Infinite places, zero scales and the like never crash, nor get into a world."""
    properties = (
        "Location=(X={},Y={},Z={})\n".format(*place)
        + "DrawScale3D=(X={},Y={},Z={})\n".format(*scale)
        + f"Rotation=(Yaw={number})\nPolyFlags={number}\n"
    )
    text = level(
        room(),
        brush("B", (0, 0, 0), (100, 100, 100), properties=properties),
        actor("MaleVictim", "V", properties=properties),
        actor("PathNode", "P", properties=properties),
        actor("PointLight", "L", properties=properties + f"Radius={number}\nBrightness={number}"),
        actor("PlayerStart", "Q", properties=properties),
        start("S", (0, 0, 60)),
    )
    assert attempt(tmp_path, text.encode())


def test_ten_gigabytes_are_not_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A file that claims 10 GB is refused before anybody reads it (exit code 2)."""
    path = tmp_path / "huge.t3d"
    with path.open("wb") as file:
        file.write(b"Begin Map\n")
        file.truncate(10 << 30)
    tracemalloc.start()
    assert main(["import", str(path), "--out", str(tmp_path)]) == 2
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert "larger than" in capsys.readouterr().err
    assert peak < 64 << 20


def test_monster_brushes_are_dropped(tmp_path: Path) -> None:
    """A brush of tens of thousands of faces costs a warning, not an hour."""
    faces = "\n".join(polygon(face) for face in cuboid((0, 0, 0), (250, 250, 250)))
    monster = brush("Monster", (0, 0, 0), (1, 1, 1)).replace(
        "End Polygon\nEnd PolyList",
        "End Polygon\n" + (faces + "\n") * (MAX_POLYGONS // 5) + "End PolyList",
    )
    source = tmp_path / "monster.t3d"
    source.write_text(level(room(), monster, start("S", (0, 0, 60))))
    report = import_map(Request(source)).report
    assert any(subject == "Monster" for subject, _, _ in report.warnings)
    assert report.totals["brush cells"] == 6


def test_an_error_leaves_the_old_world(tmp_path: Path) -> None:
    """A map that became unreadable does not touch the world made from it before (worlds 73)."""
    source = tmp_path / "map.t3d"
    source.write_text(two_rooms())
    folder = import_map(Request(source, out=tmp_path / "out")).folder
    before = (folder / "scene.xml").read_bytes()
    source.write_text(two_rooms()[:500])
    with pytest.raises(MapImportError):
        import_map(Request(source, out=tmp_path / "out"))
    assert (folder / "scene.xml").read_bytes() == before


TEXTURE = "vt 0.5 0.5"


@pytest.mark.parametrize("bad", ["1e8", "1e30", "1e300", "1e308", "-1e308", "inf"])
def test_a_corner_at_no_place(tmp_path: Path, bad: str) -> None:
    """A vertex farther away than any map is as one that is not finite: its triangles go."""
    write(tmp_path, f"{obj(TEXTURE)}v {bad} 1 {bad}\nf 1 2 5\n", "far.obj")
    mesh = model("m", shape("<mesh><uri>far.obj</uri><scale>1 1 2</scale></mesh>"))
    for path in (tmp_path / "far.obj", write(tmp_path, world(mesh + model("k", BOX)))):
        report = import_map(Request(path)).report
        assert max(report.extents) < 10.0
        assert report.totals["triangles dropped"] == 1


def test_places_in_x3d(tmp_path: Path, findings: Findings) -> None:
    """A field of a Transform or a colour that makes no sense has its default."""
    text = (
        '<X3D><Scene>\n<Transform translation="0 nan 0" scale="2 3-2 2"><Shape><Appearance>'
        '<Material diffuseColor="1 x 0"/></Appearance><Box size="1 1 1"/></Shape></Transform>'
        "</Scene></X3D>"
    )
    mesh = whole(read(write(tmp_path, text, "map.x3d"), findings))
    assert np.ptp(mesh.vertices, axis=0).tolist() == [2.0, 2.0, 1.0]
    assert "map.x3d: line 2: translation '0 nan 0' makes no sense; left out" in told(findings)
    assert "diffuseColor '1 x 0'" in told(findings)


FALLING = "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"


def test_libraries_are_not_heard(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What libraries warn of, log and print goes to the log at `debug`, not to the terminal."""
    real = read_scene

    def noisy(source: Path, context: Context) -> Scene:
        warnings.warn("invalid value encountered in matmul", RuntimeWarning, stacklevel=1)
        logging.getLogger("trimesh").warning("unable to load materials")
        model = mujoco.MjModel.from_xml_string(FALLING)
        data = mujoco.MjData(model)
        data.qpos[0] = np.nan
        mujoco.mj_step(model, data)
        logging.getLogger("usarsim.plugins").warning("one of our own")
        return real(source, context)

    monkeypatch.setattr(convert, "read_scene", noisy)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(logging.getLogger(), "handlers", [])  # as without pytest
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        import_map(Request(write(tmp_path, obj(TEXTURE), "map.obj")))
    assert capfd.readouterr() == ("", "one of our own\n")
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()
