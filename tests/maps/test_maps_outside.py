"""What a map names is read only inside its folder and the asset folders, and only if it is a file.

Every map here wants a picture or a mesh that lies beside its folder; what gets into the world is
looked at, pixel by pixel.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lanes import slow_but
from mesh_samples import FUZZ, dae_textured
from PIL import Image
from sdf_samples import model, shape, world

from usarsim_maps.convert import Imported, Request, import_map
from usarsim_maps.findings import Findings
from usarsim_maps.gazebo.files import GazeboFiles
from usarsim_maps.meshes.mesh_files import Pictures
from usarsim_maps.reader import Context, ImportOptions
from usarsim_server.base.errors import MapImportError
from usarsim_server.base.files import Folders

SECRET = (123, 45, 67)
OBJ = "mtllib m.mtl\nv 0 0 0\nv 3 0 0\nv 0 3 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n"
GLTF = """{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
"nodes": [{"mesh": 0}], "meshes": [
{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
"textures": [{"source": 0}], "images": [{"uri": "IMAGE"}],
"accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
"bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 36}],
"buffers": [{"byteLength": 36, "uri": "BUFFER"}]}"""
BYTES = "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAABAQAAAAAAAAAAAAAAAAAAAQEAAAAAA"
BOX = "<box><size>4 4 1</size></box>"


def gazebo_picture(uri: str) -> str:
    """A world with a box that has a picture."""
    look = f"<material><pbr><metal><albedo_map>{uri}</albedo_map></metal></pbr></material>"
    return world(model("m", shape(BOX, more=look)))


def gazebo_script(uri: str) -> str:
    """A world with a box that has a material of a script."""
    look = f"<material><script><uri>{uri}</uri><name>A</name></script></material>"
    return world(model("m", shape(BOX, more=look)))


def beside_a_box(geometry: str) -> str:
    """A world with a box and another shape."""
    return world(model("b", shape(BOX)) + model("m", shape(geometry)))


MAPS: dict[str, Callable[[Path], dict[str, str]]] = {
    "gazebo picture ..": lambda out: {"map.world": gazebo_picture("../out/secret.png")},
    "gazebo picture file:": lambda out: {"map.world": gazebo_picture(f"file://{out}/secret.png")},
    "gazebo picture %2e": lambda out: {"map.world": gazebo_picture("%2e%2e/out/secret.png")},
    "gazebo picture backslash": lambda out: {"map.world": gazebo_picture("..\\out\\secret.png")},
    "gazebo picture link": lambda out: {"map.world": gazebo_picture("link/secret.png")},
    "gazebo height map": lambda out: {
        "map.world": beside_a_box(
            "<heightmap><uri>../out/secret.png</uri><size>9 9 1</size></heightmap>"
        )
    },
    "gazebo mesh": lambda out: {
        "map.world": beside_a_box(f"<mesh><uri>file://{out}/secret.obj</uri></mesh>")
    },
    "gazebo script": lambda out: {
        "map.world": gazebo_script("a.material"),
        "a.material": "material A { technique { pass { texture_unit { texture "
        "../out/secret.png } } } }",
    },
    "gazebo model beside": lambda out: {
        "map.world": world("<include><uri>model://out</uri></include>" + model("m", shape(BOX)))
    },
    "obj": lambda out: {"map.obj": OBJ, "m.mtl": "newmtl m\nmap_Kd ../out/secret.png\n"},
    "obj link": lambda out: {"map.obj": OBJ, "m.mtl": "newmtl m\nmap_Kd link/secret.png\n"},
    "obj absolute": lambda out: {"map.obj": OBJ, "m.mtl": f"newmtl m\nmap_Kd {out}/secret.png\n"},
    "gltf": lambda out: {
        "map.gltf": GLTF.replace("IMAGE", "../out/secret.png").replace("BUFFER", BYTES)
    },
    "collada": lambda out: {"map.dae": dae_textured(f"file://{out}/secret.png")},
    "sidecar": lambda out: {
        "map.obj": OBJ.replace("mtllib m.mtl\n", ""),
        "map.usarsim.toml": '[material.m]\ntexture = "../out/secret.png"\n',
    },
}


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder `in` for maps, beside it `out` with things that are nobody's business."""
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "link").symlink_to(out)
    Image.new("RGB", (4, 4), SECRET).save(out / "secret.png")
    (out / "secret.obj").write_text("v 0 0 0\nv 70 0 0\nv 0 70 0\nf 1 2 3\n")
    (out / "model.config").write_text('<model><sdf version="1.6">model.sdf</sdf></model>')
    look = "<material><pbr><metal><albedo_map>secret.png</albedo_map></metal></pbr></material>"
    text = f'<sdf version="1.6">{model("stranger", shape(BOX, more=look))}</sdf>'
    (out / "model.sdf").write_text(text)
    return tmp_path


def bring(place: Path, files: dict[str, str], **options: object) -> Imported:
    """Import the first of the files, without a cache that other tests share."""
    for name, text in files.items():
        (place / "in" / name).write_text(text, encoding="utf-8")
    chosen = ImportOptions(**options)  # type: ignore[arg-type]
    source = place / "in" / next(iter(files))
    return import_map(Request(source, place / "worlds", options=chosen, cache=place / "cache"))


def leaked(done: Imported) -> bool:
    """Whether anything of the secret is in a world."""
    for path in done.folder.rglob("*.png"):
        with Image.open(path) as image:
            if image.convert("RGB").getpixel((0, 0)) == SECRET:
                return True
    scene = (done.folder / "scene.xml").read_text()
    return "hfield" in scene or "stranger" in scene or done.report.extents[0] > 50.0


@pytest.mark.parametrize("name", MAPS)
def test_nothing_from_outside_gets_into_a_world(place: Path, name: str) -> None:
    """The report names the file, who asks for it and the cure; with leave it is read."""
    files = MAPS[name](place / "out")
    done = bring(place, files)
    assert not leaked(done)
    said = [text for _, text, _ in done.report.warnings if "outside the given folders" in text]
    assert said, done.report.warnings
    assert "asks for" in said[0]
    assert "--allow-outside" in said[0]
    assert leaked(bring(place, files, allow_outside=True))
    assert leaked(bring(place, files, assets=(place / "out", place)))


def test_what_a_map_cannot_do_without_is_an_error(place: Path) -> None:
    """The picture of a grid, the bytes of a mesh, the folders of a sidecar nobody named."""
    Image.new("L", (30, 30), 254).save(place / "out" / "map.png")
    grid = "image: ../out/map.png\nresolution: 0.1\norigin: [0, 0, 0]\n"
    with pytest.raises(MapImportError, match=r"map.yaml asks for .*outside.*--allow-outside"):
        bring(place, {"map.yaml": grid})
    (place / "in" / "a.bin").symlink_to(place / "out" / "secret.png")
    mesh = GLTF.replace("IMAGE", "x.png").replace("BUFFER", "a.bin")
    with pytest.raises(MapImportError, match=r"map.gltf asks for .*outside"):
        bring(place, {"map.gltf": mesh})
    sidecar = {"map.obj": OBJ, "map.usarsim.toml": 'assets = ["../out"]\n'}
    with pytest.raises(MapImportError, match=r"assets: .*map.usarsim.toml asks for .*outside"):
        bring(place, sidecar)
    given = Request(
        place / "in" / "map.obj", place / "worlds", sidecar=place / "in" / "map.usarsim.toml"
    )
    assert import_map(given).folder.is_dir()


def test_layers_of_a_stage(place: Path) -> None:
    """References of USD files are looked at before anybody opens them."""
    pytest.importorskip("pxr")
    stage = '#usda 1.0\n(metersPerUnit = 1\nupAxis = "Z"\n)\ndef "A" (references = @NAME@) {}\n'
    cube = '#usda 1.0\n(defaultPrim = "C"\n)\ndef Cube "C" {}\n'
    (place / "out" / "c.usda").write_text(cube)
    os.mkfifo(place / "in" / "pipe.usda")
    with pytest.raises(MapImportError, match=r"map.usda asks for .*c.usda.*outside"):
        bring(place, {"map.usda": stage.replace("NAME", "../out/c.usda")})
    with pytest.raises(MapImportError, match="named pipe"):
        bring(place, {"map.usda": stage.replace("NAME", "pipe.usda")})
    assert bring(place, {"map.usda": stage.replace("NAME", "../out/c.usda")}, allow_outside=True)


SCHEMES = st.sampled_from(
    ["", "file://", "file:///", "model://", "package://", "FILE://", "http://"]
)
SIGNS = st.sampled_from(
    ["..", "%2e%2e", "%252e", ".", "/", "\\", "%2f", "%5C", "C:", "C:\\", "\\\\host\\c", "\0",
     "%00", "~", "out", "OUT", "in", "link", "secret.png", "SECRET.png", "a" * 300,
     "\u2024\u2024", " ", '"', "é"]
)  # fmt: skip


@settings(FUZZ, max_examples=400)
@given(scheme=SCHEMES, parts=st.lists(SIGNS, max_size=9), glue=st.sampled_from(["/", "\\", ""]))
def test_no_address_leads_out(place: Path, scheme: str, parts: list[str], glue: str) -> None:
    """Whatever is written, finders answer with files in the folder or with nothing."""
    source = place / "in" / "map.world"
    folders = Folders([place / "in"])
    context = Context(ImportOptions(), Findings(), folders=folders)
    name = scheme + glue.join(parts)
    found = [GazeboFiles(source, context).find(name, source), context.index(source).find(name)]
    pictures = Pictures(source, context)
    pictures.find(name)
    found += pictures.files
    assert all(path is None or folders.admit(path) for path in found), (name, found)


HANGS = {
    "map.world": gazebo_picture("pipe.png"),
    "map.obj": OBJ,
    "map.gltf": GLTF.replace("IMAGE", "pipe.png").replace("BUFFER", BYTES),
    "map.dae": dae_textured("pipe.png"),
    "map.yaml": "image: pipe.png\nresolution: 0.1\norigin: [0, 0, 0]\n",
    "script.world": gazebo_script("."),
}


@pytest.mark.parametrize(
    "name",
    slow_but(
        {"map.world", "pipe.t3d", "folder.obj"}.__contains__,
        [*HANGS, "pipe.t3d", "pipe.sdf", "folder.obj", "sidecar.obj"],
    ),
)
def test_pipes_keep_nobody_waiting(place: Path, name: str) -> None:
    """In place of pictures, scripts, material libraries, sidecars, of the map itself."""
    for pipe in ("pipe.png", "m.mtl", "pipe.material", "pipe.t3d", "pipe.sdf", "LICENSE"):
        os.mkfifo(place / "in" / pipe)
    os.mkfifo(place / "in" / "1_Placement.txt")
    os.mkfifo(place / "in" / "sidecar.usarsim.toml")
    (place / "in" / "folder.obj").mkdir()
    (place / "in" / "sidecar.obj").write_text(OBJ)
    if name in HANGS:
        (place / "in" / name).write_text(HANGS[name])
    command = [sys.executable, "-m", "usarsim_server", "import"]
    done = subprocess.run(
        [*command, str(place / "in" / name), "--out", str(place / "worlds")],
        env={**os.environ, "XDG_CACHE_HOME": str(place / "cache")},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode in (0, 2), done.stderr
    assert "Traceback" not in done.stderr
    if done.returncode == 2:
        assert done.stderr.count("\n") == 1
    else:
        assert name in HANGS or name == "sidecar.obj"
