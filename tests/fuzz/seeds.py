"""Small inputs that lead a long way into each reader; all written for this purpose.

The samples of maps are those of the importers' own tests.
"""

from __future__ import annotations

import io
import json
import struct
import zlib
from pathlib import Path

import gltf_samples
import mesh_samples as samples
import numpy as np
from fbx_samples import FbxFile
from lzo_fixture import lzo_pack
from mesh_samples import FACES, WEDGE
from PIL import Image
from robot_files import table, write
from sdf_samples import BOX, PLUGIN, model
from sdf_samples import world as sdf_world
from t3d_maps import actor, level, room, start
from udk_maps import Map, box_triangles, static_mesh
from unreal_fixture import Writer

ROOT = Path(__file__).parents[2]

SCENE = b"""<mujoco model="yard"><worldbody>
<light type="directional" dir="0 0 -1"/><geom name="floor" type="plane" size="0 0 1"/>
<body name="crate" pos="2 0 0.2"><freejoint/><geom type="box" size="0.2 0.2 0.2" mass="2"/></body>
</worldbody></mujoco>
"""


def control() -> list[bytes]:
    """Lines of all commands."""
    return [line.encode() + b"\r\n" for line in _CONTROL.splitlines()] + [
        b"\xef\xbb\xbfDRIVE {Left 1,5}\n\n\r{Right}}{ {} x",
        b"GETPOSGETOBS DRIVE {Left 1} INIT {Name a\x00\x7f}\r\n",
    ]


_CONTROL = """INIT {ClassName USARBot.P2AT} {Location 4.5,1.9,1.8} {Rotation 0,0,1.57} {Name R1}
INIT {ClassName USARBot.WorldController} {Name W}
INIT {ClassName P3AT} {Start RobotStart1} {Dialect udk}
DRIVE {Left 1.0} {Right -1.0} {Normalized False} {Light True} {Flip True}
DRIVE {Speed 1.5} {FrontSteer 0.3} {RearSteer 0} {Normalized true}
DRIVE {WheelNumber 1} {WheelSpeed 2} {WheelSteer 0.2} {WheelNumber 2} {WheelSpeed 2}
DRIVE {AltitudeVelocity 1} {LinearVelocity 2} {LateralVelocity 3} {RotationalVelocity 4}
DRIVE {Propeller 1} {Rudder 0.1} {SternPlane -0.1}
DRIVE {Name Joint1} {Steer 45} {Order 1} {Value 1e3}
MULTIDRIVE {FRFlipper 0.5} {FLFlipper 0.5} {RRFlipper 1} {RLFlipper 1}
MISPKG {Name CameraPanTilt} {Link 1} {Value 0.5} {Order 0} {Link 2} {Value 1} {Order 1}
MISPKG {Name Arm} {Sequence 3} {Link 1} {Value 1}
ACT {Name Arm} {Sequence 4} {Link 1} {Value 0.25}
SET {Type Camera} {Name Camera1} {Opcode Zoom} {Params 0.6}
SET {Type Joint} {Name LeftHip} {Opcode Angle} {Params 0.3}
SET {Type Viewports} {Config QuadView} {Viewport1 Camera}
GETCONF {Type RangeScanner} {Name Scanner1}
GETGEO {Type Robot}
GETSTARTPOSES
GETCLOSESTPATHNODE {Location 1,2,3}
GETPOS
SYNC {Ticks 5}
MOVE {Name Walker} {Location 1,2,0} {Speed 1}
GOTO {Node 12}
CONTROL {Type Create} {ClassName Box} {Name b} {Location 1,2,3} {Rotation 0,0,0} {Physics None}
CONTROL {Type AddWP} {Name b} {WP 1,2,3;4,5,6;7,8,9} {Speed 2} {Autostart True}
CONTROL {Type RelMove} {Name b} {Location 0.1,0,0}
CONTROL {Type KillAll} {MaxTorque 20}
TRACE {On true} {Interval 0.5}
CAMERA {Camera 1} {Robot R1}
"""


def numbers() -> list[bytes]:
    """Numbers in the ways of all clients."""
    return [b"-1.5e3", b" 0,5 1,0 1,8", b".5", b"+7.25junk", b"1e999", b"-0", b"nan", b"0x10"]


def names() -> list[bytes]:
    """Names, good and bad."""
    return [b"Rover7", b"Evil Location 9,9,0", b"{a}\r\n\x00\xff", b"x" * 64, b" \t", b"Robot_2"]


def image() -> list[bytes]:
    """Requests of image clients."""
    return [b"OK", b"OOK" * 3, b"xxU" + struct.pack("<4I", 0, 0, 320, 240) + b"OK\r\n", b"U" * 40]


def wireless() -> list[bytes]:
    """All verbs of the wireless port."""
    lines = [
        b"INIT {Robot Rover1} {Port 3333;2323}",
        b"GETSS {Robot Rover2}",
        b"DNS {Robot Rover2} {Port 3333}",
        b"REVERSEDNS {Port 50123}",
        b"GETPOS",
        b"getobs {From a} {To b}",
    ]
    return [*(line + b"\r\n" for line in lines), b"\r\n".join(lines) + b"\r\n"]


def ground_truth() -> list[bytes]:
    """Both questions."""
    return [
        b"GETPOS\r\n",
        b"GETOBS {From R1} {To R2}\r\n",
        b"getobs {Start 1,2,3} {End -4.5, 0, 1e2}\r\nGETOBS {From x}\r\n",
    ]


def truth() -> list[bytes]:
    """Queries of scoring tools."""
    return [b"\r\n", b"{Class USARBot.P2AT}\r\n", b"{Name R1}\n\n{Class a.b.c} {Name}\n"]


def comserver() -> list[bytes]:
    """All messages of the older wireless simulation."""
    texts = b"REGISTER R1;LISTEN R1 3333;OPEN R1 R2 3333;GETSS R1 R2;CLOSE;;x y z;"
    return [texts, *(one + b";" for one in texts.split(b";"))]


def link() -> list[bytes]:
    """Data in the way of its links."""
    return [b"SEND 5 hello;SEND 0 ;CLOSE;", b"SEND x;  SEND 3 abc\nCLOSE ignored;", b"SEND 99999 a"]


def robot() -> list[bytes]:
    """A small robot, and shipped ones."""
    import tempfile

    with tempfile.TemporaryDirectory() as place:
        small = write(Path(place), "Fuzzed", table()).read_bytes()
    names = ("P3AT", "Nao", "Kenaf", "AirRobot", "Submarine", "Hummer")
    shipped = (ROOT / "robots" / f"{name}.toml" for name in names)
    return [small, *(path.read_bytes() for path in shipped if path.is_file())]


def world() -> list[bytes]:
    """A small world, and shipped ones."""
    small = (
        b'title = "Yard"\n[[start]]\ntag = "A"\nposition = [0.0, 0.0, 0.25]\n'
        b'[[victim]]\nname = "V"\nposition = [1.0, 2.0, 0.12]\nposture = "lying"\n'
    )
    return [small, *(path.read_bytes() for path in sorted(ROOT.glob("worlds/*/world.toml")))]


def objects() -> list[bytes]:
    """The shipped classes."""
    return [path.read_bytes() for path in sorted(ROOT.glob("worlds/*.toml"))]


def radio() -> list[bytes]:
    """Every key that the page on the wireless simulation names."""
    page = (ROOT / "docs" / "wireless.md").read_text()
    blocks = [block.partition("```")[0] for block in page.split("```toml\n")[1:]]
    return [b'model = "obstacle"\ncutoff = -93\n', *(block.encode() for block in blocks)]


def settings() -> list[bytes]:
    """Some settings of each kind."""
    return [
        b'world = "empty"\nport = 0\nimage_port = "off"\nspeed = "max"\ntiles = "4x4"\n'
        b'tile_size = "320x240"\nseed = 7\nrobots = ["robots"]\nmax_robots = 2\n'
        b'dialect = "udk"\nidle_timeout = 30\nspectator = ["top"]\n[wireless]\nmodel = "distance"\n'
    ]


def sidecar() -> list[bytes]:
    """What can stand beside a map."""
    page = (ROOT / "docs" / "import.md").read_text()
    blocks = [block.partition("```")[0] for block in page.split("```toml\n")[1:]]
    start = b'scale = 100\nup = "Z"\n[[start]]\ntag = "A"\nposition = [0.0, 0.0, 0.25]\n'
    return [start, *(block.encode() for block in blocks)]


def recording() -> list[bytes]:
    """A recorded session, whole and cut off."""
    lines = (
        b'{"usarsim_recording": 1, "taken": "2026", "links": [{"listen": 1, "to": "h:2"}]}\n'
        b'{"t": 0, "connection": 1, "event": "open", "link": 0}\n'
        b'{"t": 0.5, "connection": 1, "event": "data", "from": "client", "text": "GETPOS\\r\\n"}\n'
        b'{"t": 1, "connection": 1, "event": "data", "from": "server", "base64": "/wAK"}\n'
        b'{"t": 2, "connection": 1, "event": "end", "from": "client"}\n'
    )
    return [lines, lines[:-20]]


def t3d() -> list[bytes]:
    """A level with a bit of everything."""
    inside = [
        actor(kind, f"{kind}_0", (100, 50, 60), "DrawScale=2\nRotation=(Yaw=100)")
        for kind in ("PathNode", "MaleVictim", "PointLight", "StaticMeshActor")
    ]
    return [level(room(), start("S", (0, 0, 60)), *inside).encode(), level(room()).encode("utf-16")]


def ase() -> list[bytes]:
    """A triangle."""
    return [
        b"*3DSMAX_ASCIIEXPORT\t200\n*MATERIAL_LIST {\n*MATERIAL_COUNT 1\n*MATERIAL 0 {\n"
        b'*MATERIAL_NAME "Stone"\n}\n}\n*GEOMOBJECT {\n*NODE_NAME "T"\n*MESH {\n*MESH_NUMVERTEX 3\n'
        b"*MESH_VERTEX_LIST {\n*MESH_VERTEX 0 0 0 0\n*MESH_VERTEX 1 250 0 0\n*MESH_VERTEX 2 0 5 0\n"
        b"}\n*MESH_FACE_LIST {\n*MESH_FACE 0: A: 0 B: 2 C: 1 AB: 1 BC: 1 CA: 1\n}\n}\n"
        b"*MATERIAL_REF 0\n}\n"
    ]


def unreal() -> list[bytes]:
    """A package with a room, plain and compressed, and one with a mesh."""
    made = Map()
    made.box("Room", (-500, -500, 0), (500, 500, 750), "CSG_Subtract")
    made.start("PlayerStart_0", (0, 0, 60))
    meshes = Writer(flags=1)
    static_mesh(meshes, "Table", box_triangles((0, 0, 0), (500, 250, 200)), group="Kitchen")
    packed = [made.content(1, zlib.compress), made.content(2, lzo_pack)]
    return [made.content(), meshes.content(), *packed]


def map_numbers() -> list[bytes]:
    """Lists of numbers in the ways of people and of C libraries."""
    return [
        b"1 2 3 0 0 -3.14/2",
        b"1,5 2 0 0 0 pi",
        b"2*(1+0.5f) -1.#IND00 nan(ind)",
        b"1, 2, 3",
        b"((1",
    ]


def sdf() -> list[bytes]:
    """A world with models, a light, people and starts."""
    heap = (
        '<model name="hill"><static>true</static><pose>1 2 0 0 0 1</pose><link name="l">'
        '<collision name="c"><geometry><cylinder><radius>1</radius><length>2</length></cylinder>'
        "</geometry></collision></link></model>"
        '<light name="sun" type="directional"><direction>0 0 -1</direction></light>'
        "<include><uri>model://ground_plane</uri><pose>0 0 0 0 0 0</pose></include>"
    )
    odd = model("box", BOX.replace("1 2 3", "1,5 2/2 nan")).replace(
        "<link", "<pose>1 2 3 0 0 -3.14/2 7</pose><link"
    )
    outline = "".join(f"<point>{x} {y}</point>" for x, y in ((0, 0), (1, 0), (0, 1)))
    newer = (
        '<frame name="f" attached_to="box::link"><pose relative_to="box">1 0 0</pose></frame>'
        f'<population name="p">{model("c", BOX)}<pose>0 0 0</pose><box><size>4 4 1</size></box>'
        "<model_count>3</model_count><distribution><type>uniform</type><rows>2</rows><cols>2</cols>"
        "<step>1 1 1</step></distribution></population>"
        f"{model('ring', f'<visual><geometry><polyline>{outline}</polyline></geometry></visual>')}"
        '<state><model name="box"><pose>1 2 3 0 0 0</pose><scale>1 2 3</scale><link name="link">'
        "<pose>3 2 1 0 0 0</pose></link></model><deletions><name>ring</name></deletions></state>"
        '<joint name="j" type="fixed"><parent>box</parent><child>f</child></joint>'
        '<include merge="true"><uri>map.world</uri></include>'
    )
    texts = (model("box", BOX) + heap, odd + heap, model("box", BOX, static=False) + newer)
    return [sdf_world(text + PLUGIN).encode() for text in texts]


def urdf() -> list[bytes]:
    """A robot of two links with colours, a mesh that is missing and what Gazebo adds."""
    shape = '<origin xyz="0 0 1" rpy="0 0 1"/><geometry>{}</geometry>'
    box, mesh = '<box size="1 2 3"/>', '<mesh filename="package://a/b.stl" scale="1 1 2"/>'
    return [
        (
            '<robot name="r"><material name="red"><color rgba="1 0 0 1"/></material>'
            '<link name="a"><inertial><mass value="2"/></inertial>'
            f'<visual>{shape.format(box)}<material name="red"/></visual>'
            f"<collision>{shape.format(box)}</collision></link>"
            f'<link name="b"><visual>{shape.format(mesh)}</visual></link>'
            '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
            '<gazebo reference="a"><material>Gazebo/Red</material><mu1>0.5</mu1></gazebo></robot>'
        ).encode()
    ]


def collada() -> list[bytes]:
    """A wedge."""
    return [samples.dae(samples.dae_wedge()).encode()]


def gltf() -> list[bytes]:
    """The wedge as text."""
    return [json.dumps(gltf_samples.gltf()).encode()]


def glb() -> list[bytes]:
    """The wedge as bytes."""
    return [gltf_samples.glb(gltf_samples.gltf())]


def obj() -> list[bytes]:
    """The wedge, with what else there is in such files."""
    lines = ["mtllib no.mtl", "o one", "usemtl red"]
    lines += ["v {:g} {:g} {:g}".format(*point) for point in WEDGE]
    lines += ["vt 0 0", "vn 0 0 1", "g a b"]
    lines += ["f {}/1/1 {}/1 {}//1".format(*(face + 1)) for face in FACES]
    lines += ["f -1 -2 -3 -4", "l 1 2", "s off", "v 1,5 -1.#IND 2", "f 1/9 2/-7 5/0"]
    return ["\n".join(lines).encode()]


def stl() -> list[bytes]:
    """A triangle as text and as bytes."""
    text = b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    corners = struct.pack("<12f", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0)
    binary = b"made by hand".ljust(80) + struct.pack("<I", 1) + corners + b"\0\0"
    return [text + b"endloop\nendfacet\nendsolid a\n", binary]


def ply() -> list[bytes]:
    """The wedge as text and as bytes."""
    head = (
        "ply\nformat {} 1.0\ncomment by hand\nelement vertex 4\nproperty float x\n"
        "property float y\nproperty float z\nproperty uchar red\nelement face 4\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    rows = ["{:g} {:g} {:g} 9".format(*point) for point in WEDGE]
    rows += ["3 {} {} {}".format(*face) for face in FACES]
    binary = b"".join(struct.pack("<3fB", *point, 9) for point in WEDGE.tolist())
    binary += b"".join(struct.pack("<B3i", 3, *face) for face in FACES.tolist())
    text = head.format("ascii") + "\n".join(rows) + "\n"
    floats = head.replace("uchar int", "float float").format("binary_big_endian").encode()
    floats += b"".join(struct.pack(">3fB", *point, 9) for point in WEDGE.tolist())
    floats += b"".join(struct.pack(">4f", 3, *face) for face in FACES.tolist())
    plain = head.format("binary_little_endian").encode() + binary
    return [text.encode(), text.replace("2 0 0 9", "2,5 0 1.#IND 9").encode(), plain, floats]


def x3d() -> list[bytes]:
    """A transform with a shape, used twice."""
    points = ", ".join("{:g} {:g} {:g}".format(*point) for point in WEDGE)
    index = " ".join("{} {} {} -1".format(*face) for face in FACES)
    return [
        '<X3D><head><unit category="length" conversionFactor="2"/></head><Scene>'
        '<Transform DEF="A" translation="1 2 3" rotation="0 1 0 1"><Shape><Appearance>'
        '<Material diffuseColor="1 0 0"/></Appearance><IndexedFaceSet coordIndex='
        f'"{index}"><Coordinate point="{points}"/></IndexedFaceSet></Shape></Transform>'
        '<Switch whichChoice="0"><Transform USE="A"/></Switch><Inline url="no.wrl"/>'
        '<Shape><ElevationGrid xDimension="2" zDimension="2" height="0 1 2 3"/></Shape>'
        "</Scene></X3D>".encode()
    ]


def vrml() -> list[bytes]:
    """The same in the classic syntax."""
    points = ", ".join("{:g} {:g} {:g}".format(*point) for point in WEDGE)
    index = " ".join("{} {} {} -1".format(*face) for face in FACES)
    return [
        "#VRML V2.0 utf8\nPROTO P [ field SFInt32 n 1 ] { Group {} }\nDEF A Transform {\n"
        "scale 1 2 1 children [ Shape { geometry IndexedFaceSet { coord Coordinate {"
        f" point [ {points} ] }} coordIndex [ {index} ] }} }} Shape {{ geometry Sphere {{}} }} ]"
        " }\nGroup { children USE A } ROUTE A.x TO A.y\n".encode()
    ]


def off() -> list[bytes]:
    """The wedge."""
    return [samples.OFF.encode()]


def _pixels() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    pixels = np.full((12, 16), 254, dtype=np.uint8)
    pixels[[0, -1], :] = 0
    pixels[:, [0, -1]] = 0
    return pixels


def ros_map() -> list[bytes]:
    """A map server's file; the picture beside it is missing."""
    return [
        b"image: map.pgm\nresolution: 0.1\norigin: [-3.0, -2.0, 0.0]\nnegate: 0\n"
        b"occupied_thresh: 0.65 # walls\nfree_thresh: 0.196\nmode: trinary\n"
    ]


def picture() -> list[bytes]:
    """The grid in several formats; the reader goes by the first bytes."""
    found = []
    for form in ("PNG", "PPM", "BMP", "GIF"):
        stream = io.BytesIO()
        Image.fromarray(_pixels()).save(stream, form)
        found.append(stream.getvalue())
    return found


def mresim() -> list[bytes]:
    """MRESim's text."""
    return [b"3\n4\n1111\n1001\n1111\n"]


def usd() -> list[bytes]:
    """A cube."""
    return [
        b'#usda 1.0\n(\n    upAxis = "Z"\n    metersPerUnit = 1\n)\ndef Xform "World"\n{\n'
        b'    def Cube "Box"\n    {\n        double size = 2\n'
        b"        double3 xformOp:translate = (1, 2, 3)\n"
        b'        uniform token[] xformOpOrder = ["xformOp:translate"]\n    }\n}\n'
    ]


def fbx() -> list[bytes]:
    """A block and a start, in one binary file: each input takes a process."""
    return [_fbx_file().binary(packed=True)]


def fbx_text() -> list[bytes]:
    """The same as text."""
    return [_fbx_file().text6(), _fbx_file().text7()]


def _fbx_file() -> FbxFile:
    file = FbxFile()
    file.mesh("Block", size=100.0)
    file.model("PlayerStart")
    return file
