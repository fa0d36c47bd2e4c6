"""Packages of Unreal Engine 3: tables, properties, compression; damage is one clear error."""

from __future__ import annotations

import contextlib
import random
import re
import struct
import zlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lzo_fixture import lzo_pack
from mesh_samples import FUZZ, refused, survives, write
from udk_maps import TABLE, Map, box_nodes, box_triangles, convex, room, scene_of, static_mesh
from unreal_fixture import (
    TAG,
    Enumeration,
    Name,
    Object,
    Ref,
    Struct,
    Structs,
    Writer,
    blocks,
    rotator,
    string,
    vector,
    zlib_pack,
)

from usarsim_maps.findings import Findings
from usarsim_maps.reader import find_reader
from usarsim_maps.unreal.archive import LZO, ZLIB, Archive, PackageError, inflate_part, lzo1x
from usarsim_maps.unreal.package import NEWEST, OLDEST, open_package
from usarsim_maps.unreal.properties import read_object

# ---- the cursor ----------------------------------------------------------------------------


def test_numbers_and_strings() -> None:
    """Values are little-endian; strings carry their length, negative for UTF-16."""
    data = struct.pack("<BHIiQf", 1, 2, 3, -4, 5, 0.5) + string("Wall") + string("Wänd € 壁")
    archive = Archive(data)
    assert (archive.u8(), archive.u16(), archive.u32()) == (1, 2, 3)
    assert (archive.i32(), archive.u64(), archive.f32()) == (-4, 5, 0.5)
    assert (archive.string(), archive.string()) == ("Wall", "Wänd € 壁")
    assert archive.left == 0


@pytest.mark.parametrize(
    "read",
    [
        lambda a: a.bytes(5),
        lambda a: a.skip(-1),
        lambda a: a.u64(),
        lambda a: a.floats(1 << 20, 3),
        lambda a: a.count(1),
        lambda a: a.string(),
        lambda a: a.bulk(0, "things"),
        lambda a: a.part(1 << 40),
    ],
)
def test_nothing_is_read_beyond_the_end(read: object) -> None:
    """Whatever is asked for, four bytes of large numbers yield an error and no memory."""
    assert callable(read)
    with pytest.raises(PackageError):
        read(Archive(b"\xff\xff\xff\x7f"))


def test_a_part_has_an_end() -> None:
    """A cursor over a part does not see what follows it."""
    part = Archive(b"abcdefgh").part(4)
    assert part.bytes(4) == b"abcd"
    with pytest.raises(PackageError):
        part.u8()


# ---- tables --------------------------------------------------------------------------------


def small() -> Map:
    """A map with a start and an import."""
    made = Map()
    made.start("PlayerStart_0", (250, 500, 750), "Entry")
    made.placed("StaticMeshActor", "StaticMeshActor_7", Ref("Pack.Group.Chair", "StaticMesh"))
    return made


def test_tables() -> None:
    """Names, classes, paths and outers are those that were written."""
    package = open_package(small().content())
    by_name = {export.name: export for export in package.exports}
    assert package.class_of(by_name["StaticMeshActor_7"]) == "StaticMeshActor"
    level = by_name["PersistentLevel"]
    assert package.path(by_name["PlayerStart_0"].number + 1) == "PersistentLevel.PlayerStart_0"
    inside = [export.name for export in package.inside(level)]
    assert inside == ["WorldInfo_0", "PlayerStart_0", "StaticMeshActor_7"]
    component = next(package.of_class("StaticMeshComponent"))
    mesh = read_object(package, component)[0].reference("staticmesh")
    assert package.path(mesh) == "Pack.Group.Chair"
    assert package.class_name(mesh) == "StaticMesh"
    assert package.path(0) == package.path(999) == package.class_name(-999) == ""


def test_properties() -> None:
    """Every type of property is read, case aside; what is absent or of another type is default."""
    writer = Writer()
    other = writer.add(Object("Thing", "Other_0"))
    thing = writer.add(Object("Thing", "Thing_0"))
    thing.properties = [
        ("Number", 0.25),
        ("Count", -7),
        ("Switch", True),
        ("Off", False),
        ("Tag", Name("Robot_12")),
        ("Title", "Hall"),
        ("CsgOper", Enumeration("ECsgOper", "CSG_Add")),
        ("Place", vector(1, 2, 3)),
        ("Turn", rotator(1, 81920, -3)),
        ("Tint", Struct("Color", bytes([255, 0, 51, 0]))),
        ("Friend", Ref(other)),
        ("Friends", [Ref(other), Ref(None), Ref("Pack.Far", "Thing")]),
        ("Inner", Struct("Settings", [("Depth", 3)])),
        ("List", Structs([[("Depth", 4)], [], [("Depth", 6)]])),
        ("Array[2]", 2.5),
        ("Wrong", vector(float("nan"), 0, 0)),
    ]
    package = open_package(writer.content())
    found, rest = read_object(package, package.exports[1])
    assert rest.left == 0
    assert (found.number("number", 0), found.number("count", 0)) == (0.25, -7.0)
    assert (found.number("array", 9), found.number("array", 9, 2)) == (9, 2.5)
    assert found.flag("switch", False)
    assert not found.flag("off", True)
    assert (found.text("tag"), found.text("title")) == ("Robot_12", "Hall")
    assert found.text("csgoper") == "CSG_Add"
    assert found.vector("place") == (1, 2, 3)
    assert found.rotator("turn") == (1, 81920, -3)
    assert found.color("tint") == pytest.approx((0.2, 0.0, 1.0))
    assert found.reference("friend") == 1
    assert package.path(found.references("friends")[2]) == "Pack.Far"
    inner = found.structure("inner")
    assert inner.number("depth", 0) == 3
    assert [item.number("depth", -1) for item in found.structures("list")] == [4, -1, 6]
    assert found.vector("wrong", 1.0) == (1, 1, 1)
    assert found.vector("number", 2.0) == (2, 2, 2)
    others = found.number("title", 5), found.flag("count", True), found.text("switch")
    assert others == (5, True, "")


def test_archetypes() -> None:
    """What an object does not say itself its archetype in the package says."""
    writer = Writer()
    first = writer.add(Object("Lamp", "Lamp_0", properties=[("Radius", 5.0), ("Shine", 2.0)]))
    second = Object("Lamp", "Lamp_1", archetype=first, properties=[("Shine", 3.0)])
    writer.add(second)
    package = open_package(writer.content())
    found = read_object(package, package.exports[1])[0]
    assert (found.number("radius", 0), found.number("shine", 0)) == (5.0, 3.0)


# ---- compression ---------------------------------------------------------------------------


@given(st.binary(max_size=3000), st.integers(1, 40))
@settings(deadline=None, max_examples=80)
def test_lzo_round_trip(content: bytes, repeat: int) -> None:
    """Whatever a compressor of the format has packed comes out again, short and long matches."""
    whole = content * repeat
    assert lzo1x(lzo_pack(whole), len(whole)) == whole


def test_lzo_by_hand() -> None:
    """Instructions written by hand: literals, a run, each kind of match, the end marker."""
    first = bytes([17 + 4]) + b"abcd"
    near = bytes([0b01_0_011_10, 0]) + b"xy"  # 3 bytes, 4 back, then two literals
    packed = first + near + bytes([0b0000_01_00, 0])  # 2 bytes, 2 back
    packed += bytes([0b001_00011, 0b0000_0100, 0])  # 5 bytes, 2 back
    packed += bytes([0b0001_0001, 0, 0])
    assert lzo1x(packed, 100) == b"abcd" + b"abc" + b"xy" + b"xy" + b"xyxyx"


def test_lzo_matches_far_back() -> None:
    """Matches reach back beyond 2 KiB after a run, 16 KiB, and 32 KiB."""
    noise = bytes((i * i * 31 + i // 7) % 251 for i in range(40_000))
    run = bytes([0]) + bytes((len(noise) - 18) // 255) + bytes([(len(noise) - 18) % 255])
    packed = run + noise
    packed += bytes([0b0000_00_00, 2])  # after a run: 3 bytes, 2049 + (2 << 2) back
    expected = noise + noise[-2057:-2054]
    packed += bytes([0b0001_0_010, 0b0000_1000, 0])  # 4 bytes, 16384 + 2 back
    start = len(expected) - 16386
    expected += expected[start : start + 4]
    packed += bytes([0b0001_1_001, 0b0000_1000, 0])  # 3 bytes, 32768 + 2 back
    start = len(expected) - 32770
    expected += expected[start : start + 3]
    assert lzo1x(packed + bytes([17, 0, 0]), len(expected)) == expected


@given(st.binary(max_size=200))
@settings(deadline=None)
def test_lzo_of_any_bytes(packed: bytes) -> None:
    """Any bytes end in an error or in no more bytes than allowed."""
    with contextlib.suppress(PackageError):
        assert len(lzo1x(packed, 1000)) <= 1000


@pytest.mark.parametrize(("flag", "pack"), [(ZLIB, zlib_pack), (LZO, lzo_pack)])
def test_compressed_packages(flag: int, pack: object) -> None:
    """A package with compressed chunks has the objects of the plain one."""
    plain = open_package(small().content())
    packed = open_package(small().content(flag, pack))
    assert [e.name for e in packed.exports] == [e.name for e in plain.exports]
    for one, other in zip(plain.exports, packed.exports, strict=True):
        assert plain.archive(one).bytes(one.size) == packed.archive(other).bytes(other.size)


@pytest.mark.parametrize("pack", [zlib_pack, lzo_pack])
def test_packages_compressed_as_a_whole(pack: object) -> None:
    """A file that is one compressed part is a package, too."""
    plain = small().content()
    packed = open_package(blocks(plain, pack))
    assert packed.data == plain


def test_bombs_are_refused() -> None:
    """A part that says it is, or turns out, larger than allowed stops before it is unpacked."""
    bomb = blocks(bytes(60 << 20), zlib.compress)
    assert len(bomb) < 100_000
    with pytest.raises(PackageError, match="62914560 bytes"):
        open_package(bomb)
    liar = bytearray(blocks(bytes(1000), zlib.compress))
    struct.pack_into("<I", liar, 12, 10)
    struct.pack_into("<i", liar, 20, 10)
    with pytest.raises(PackageError, match="instead of 10"):
        inflate_part(Archive(bytes(liar)), ZLIB, 1 << 20)


# ---- what is refused (worlds 72) -------------------------------------------------------------


def told(folder: Path, content: bytes) -> str:
    """The error for a file."""
    return refused(write(folder, content, "map.udk"))


def with_version(version: int) -> bytes:
    """A package of another version."""
    content = bytearray(small().content())
    struct.pack_into("<H", content, 4, version)
    return bytes(content)


@pytest.mark.parametrize(
    ("version", "reason", "cure"),
    [
        (128, "Unreal Engine 1 or 2", "T3D"),
        (512, "older than UDK", "T3D"),
        (OLDEST - 1, "older than UDK", "later UDK"),
        (NEWEST + 1, "newer than the last UDK", "T3D"),
        (0xFFF9, "Unreal Engine 4 or 5", "USD"),
    ],
)
def test_other_versions(tmp_path: Path, version: int, reason: str, cure: str) -> None:
    """Files of other generations are refused; the error says which and what helps (worlds 72)."""
    text = told(tmp_path, with_version(version))
    assert reason in text
    assert cure in text


def test_wrong_tag(tmp_path: Path) -> None:
    """Other files, and those of consoles, are told apart (worlds 72)."""
    content = small().content()
    assert "no Unreal package" in told(tmp_path, b"PK\x03\x04" + content[4:])
    assert "console" in told(tmp_path, struct.pack(">I", TAG) + content[4:])
    assert "only 0 bytes" in told(tmp_path, b"")


def test_cooked(tmp_path: Path) -> None:
    """A cooked package is refused by its flag (worlds 72)."""
    made = Map(flags=0x2000D)
    assert "cooked" in told(tmp_path, made.content())


def test_unknown_compression(tmp_path: Path) -> None:
    """LZX, the method of a console, is named (worlds 72)."""
    assert "LZX" in told(tmp_path, small().content(4, zlib_pack))


def test_truncated(tmp_path: Path) -> None:
    """Cut anywhere, a package is refused in one line that names the byte (worlds 72)."""
    content = small().content()
    for end in range(0, len(content), 37):
        text = told(tmp_path, content[:end])
        assert "byte" in text


def test_files_without_extension(tmp_path: Path) -> None:
    """A package is recognised by its tag."""
    source = tmp_path / "hall.map"
    source.write_bytes(small().content())
    assert find_reader(source).title == "Unreal UDK package"


# ---- damage --------------------------------------------------------------------------------


def rich() -> bytes:
    """A package with a bit of everything."""
    made = room()
    body = [("ConvexElems", Structs([convex([(0, 0, 0), (9, 0, 0), (0, 9, 0), (0, 0, 9)])]))]
    mesh = static_mesh(made, "Box", box_triangles((0, 0, 0), (50, 50, 50))[:4], body=body)
    made.placed("KActor", "Ball_0", Ref(mesh), [("Tag", Name("Ball"))])
    made.placed("StaticMeshActor", "Table_0", TABLE)
    made.actor("MaleVictim", "MaleVictim_0", [("DrawScale3D", vector(1, 1, 2))])
    made.actor("PathNode", "PathNode_0", [("Location", vector(1, 1, 2))])
    lamp = made.actor("PointLight", "PointLight_0")
    inner = made.add(Object("PointLightComponent", "PointLightComponent_0", lamp))
    inner.properties = [("Radius", 500.0)]
    lamp.properties.append(("LightComponent", Ref(inner)))
    made.built(box_nodes((-500, -500, 0), (500, 500, 750)), outside=0)
    return made.content()


RICH = rich()


@given(st.data())
@settings(FUZZ, max_examples=150)
def test_flipped_bytes(tmp_path: Path, data: st.DataObject) -> None:
    """A package with some bytes changed is read, or refused in one line (worlds 72)."""
    content = bytearray(RICH)
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] = data.draw(st.sampled_from([0, 1, 2, 0x7F, 0x80, 0xFF, content[place] ^ 1]))
    survives(tmp_path, "fuzz.udk", bytes(content))


def test_words_out_of_range(tmp_path: Path) -> None:
    """Large and negative numbers in any place are noticed (worlds 72)."""
    chosen = random.Random(5)
    for _ in range(300):
        content = bytearray(RICH)
        place = chosen.randrange(0, len(content) - 4)
        struct.pack_into("<i", content, place, chosen.choice([-1, 1 << 30, -(1 << 31), 65536]))
        survives(tmp_path, "fuzz.udk", bytes(content))


def test_objects_in_each_other(tmp_path: Path, findings: Findings) -> None:
    """A million references to the same object do not take a million times its size."""
    made = Map()
    big = made.add(Object("Thing", "Thing_0"))
    big.properties = [(f"P{n}", Struct("S", bytes(16))) for n in range(2000)]
    mesh = Ref("Furniture.Kitchen.Table", "StaticMesh")
    for number in range(200):
        made.placed("StaticMeshActor", f"A_{number}", mesh).archetype = big
    scene_of(tmp_path, made, findings)
    assert any("over and over" in w.text for w in findings.warnings())


def test_essential_objects(tmp_path: Path) -> None:
    """A brush that cannot be read is an error that names it; a lamp is only left out
    (worlds 72)."""
    made = room()
    brush = next(item for item in made.objects if item.kind == "Polys")
    made.actor("PointLight", "Lamp_0", [("LightComponent", Ref(brush))])
    brush.tail[0] = struct.pack("<2i", 1 << 20, 0)
    assert re.search(r"byte \d+: Room: 1048576 polygons", told(tmp_path, made.content()))
