"""Reads Wavefront OBJ with its materials.

The format knows neither units nor axes: one unit is taken for a metre and y for up, as most
modellers write it, and the report says that this was assumed (worlds reference 2.4, item 42).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar, NoReturn

import numpy as np

from usarsim_maps.files import read_text
from usarsim_maps.findings import MAX_NAMES
from usarsim_maps.meshes.mesh_files import Axes, Pictures, axes_of, broken, with_hulls
from usarsim_maps.meshes.polygons import MAX_TRIANGLES, check_count, make_mesh, triangulate
from usarsim_maps.meshes.vertex_colors import shaded_slots
from usarsim_maps.numbers import read_number
from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import Array, Material, Opacity, Part, Scene, SceneObject
from usarsim_maps.support import Support, SupportTable, support_table

MAX_BYTES = 512 << 20
MAX_MTL_BYTES = 16 << 20

_COMMENT = re.compile(r"(?<!\d\.)#.*")
"""From a hash on, unless it is that of `-1.#IND`."""


MAP_OPTIONS = {
    "-o": 3, "-s": 3, "-t": 3, "-mm": 2, "-bm": 1, "-boost": 1, "-texres": 1, "-clamp": 1,
    "-blendu": 1, "-blendv": 1, "-imfchan": 1, "-type": 1, "-cc": 1,
}  # fmt: skip
"""Options before the file name of a map, and how many words may follow each."""

BRIGHT = ("r", "g", "b", "l")
"""Channels of `-imfchan` other than the matte, which is the alpha channel."""


@dataclass(slots=True)
class _Group:
    """Faces of one object."""

    name: str
    sizes: list[int] = field(default_factory=list)
    slots: list[int] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    vertices: list[int] = field(default_factory=list)
    textures: list[int] = field(default_factory=list)


STATEMENTS = support_table(
    read="f g mtllib o usemtl v vt",
    left_out="""
        bevel bmat bsp bzp c_interp call cdc con cstype csh ctech curv curv2 d_interp deg end hole
        l lod maplib mg p parm res s scrv shadow_obj sp stech step surf trace_obj trim usemap vn vp
    """,
)
"""Statements of OBJ (Wavefront's appendix B1)."""

MTL_STATEMENTS = support_table(
    read="d Kd map_Kd map_d newmtl Tr",
    left_out="""
        aniso anisor bump decal disp illum Ka Ke Km Ks map_aat map_bump map_Ka map_Ke map_Ks map_Ns
        map_Pm map_Pr norm Ni Ns Pc Pcr Pm Pr Ps refl sharpness Tf
    """,
)
"""Statements of MTL, and those of its extension for physically based looks."""


@register("obj")
class ObjReader(Reader):
    """Meshes, one object for every `o`, or for every `g` where there is no `o`."""

    title = "Wavefront OBJ"
    extensions = (".obj",)
    head = re.compile(rb"(?m)^\s*v\s+[-+.\d]+\s+[-+.\d]+\s+[-+.\d]+")
    support: ClassVar[Mapping[str, SupportTable]] = {
        "OBJ statements": STATEMENTS,
        "MTL statements": MTL_STATEMENTS,
    }

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`."""
        axes = axes_of(context.options, "Y", stated=False)
        file = _File(source)
        file.parse(read_text(source, MAX_BYTES))
        for word in file.unread:
            context.findings.skip("OBJ statement", word)
        if file.lost:
            text = f"{file.lost} corners have texture coordinates that are not there"
            context.findings.warn(source.name, text)
        pictures = Pictures(source, context)
        known, libraries = _materials(source, file.libraries, context, pictures)
        used = {name: known.get(name, Material(name)) for name in file.materials if name}
        objects = [file.build(group, axes, used) for group in file.groups if group.sizes]
        if not objects:
            raise broken(source, "there are no faces in this file")
        context.findings.count("mesh", len(objects))
        return Scene(
            source=axes.source(source, "OBJ", [*libraries, *pictures.files]),
            objects=with_hulls(objects),
            materials=used,
        )


class _File:
    """What the lines of a file add up to."""

    def __init__(self, source: Path) -> None:
        self.groups: list[_Group] = []
        self.materials: dict[str, int] = {}
        self.libraries: list[str] = []
        self.lost = 0
        self.unread: dict[str, None] = {}  # first words of lines that have no effect
        self._source = source
        self._points: list[tuple[float, float, float]] = []
        self._uvs: list[tuple[float, float]] = []
        self._colors: dict[int, tuple[float, float, float]] = {}
        self._slot = -1
        self._by_name: dict[str, _Group] = {}
        self._has_objects = False

    def parse(self, text: str) -> None:
        """Read all lines; a `MapImportError` names the one that makes no sense."""
        corners = 0
        for number, words in _lines(text):
            try:
                match words[0]:
                    case "v":
                        self._points.append((float(words[1]), float(words[2]), float(words[3])))
                        if len(words) > 6:
                            self._color(words[4:7])
                    case "vt":
                        self._uvs.append((float(words[1]), float(words[2]) if words[2:] else 0.0))
                    case "f":
                        self._face(number, words[1:])
                        corners += len(words)
                    case "o":
                        self._has_objects = True
                        self._enter(" ".join(words[1:]))
                    case "g" if not self._has_objects:
                        self._enter(" ".join(words[1:]))
                    case "usemtl":
                        name = " ".join(words[1:])
                        self._slot = self.materials.setdefault(name, len(self.materials))
                    case "mtllib":
                        self.libraries.append(" ".join(words[1:]))
                    case word if STATEMENTS.get(word) is not Support.READ and word != "#":
                        if len(self.unread) < MAX_NAMES:
                            self.unread[word[:20]] = None
            except (ValueError, IndexError):
                if not self._again(words):
                    self._refuse(number, f"{' '.join(words)[:60]!r} is no sound line")
            if corners > 4 * MAX_TRIANGLES:
                check_count(self._source, corners)

    def _color(self, words: list[str]) -> None:
        """Keep the colour of the latest vertex; what is none is passed over."""
        try:
            color = float(words[0]), float(words[1]), float(words[2])
        except ValueError:
            try:
                color = read_number(words[0]), read_number(words[1]), read_number(words[2])
            except ValueError:
                return
        self._colors[len(self._points) - 1] = color

    def _again(self, words: list[str]) -> bool:
        """Try numbers with decimal commas, and what C prints for none; whether that helped."""
        try:
            match words[0], [read_number(word) for word in words[1:]]:
                case "v", [x, y, z, *more]:
                    self._points.append((x, y, z))
                    if len(more) >= 3:
                        self._color(words[4:7])
                case "vt", [u, v, *_]:
                    self._uvs.append((u, v))
                case _:
                    return False
        except ValueError:
            return False
        return True

    def _refuse(self, line: int, problem: str) -> NoReturn:
        raise broken(self._source, problem, line) from None

    def _enter(self, name: str) -> None:
        name = name or self._source.stem
        if name not in self._by_name:
            self._by_name[name] = _Group(name)
            self.groups.append(self._by_name[name])
        else:
            # The same name again goes on with the same object.
            group = self._by_name[name]
            self.groups.remove(group)
            self.groups.append(group)

    def _face(self, line: int, words: list[str]) -> None:
        if not self.groups:
            self._enter("")
        if self._slot < 0:
            self._slot = self.materials.setdefault("", len(self.materials))
        group = self.groups[-1]
        vertices, textures = [], []
        points, uvs = len(self._points), len(self._uvs)
        for word in words:
            first, *rest = word.split("/")
            value = int(first)
            # Nearly all are of this kind; files have millions of them.
            plain = 0 < value <= points
            vertices.append(value - 1 if plain else self._index(line, value, points))
            if not rest or not rest[0]:
                textures.append(-1)
                continue
            value = int(rest[0])
            textures.append(value - 1 if 0 < value <= uvs else self._texture(value, uvs))
        if len(vertices) < 3:
            return
        group.sizes.append(len(vertices))
        group.slots.append(self._slot)
        group.lines.append(line)
        group.vertices += vertices
        group.textures += textures

    def _index(self, line: int, value: int, count: int) -> int:
        index = value - 1 if value > 0 else count + value
        if value == 0 or not 0 <= index < count:
            self._refuse(line, f"vertex {value} of {count}")
        return index

    def _texture(self, value: int, count: int) -> int:
        """Index of texture coordinates counted from the end; -1 if there are none."""
        if value < 0 <= count + value:
            return count + value
        self.lost += 1
        return -1

    @cached_property
    def _all_points(self) -> Array:
        return np.array(self._points)

    @cached_property
    def _all_uvs(self) -> Array:
        return np.array(self._uvs)

    @cached_property
    def _all_colors(self) -> Array:
        """Colour of each vertex, 0 to 1; white where the file says none."""
        colors = np.ones((len(self._points), 3))
        rows = np.nan_to_num(np.array(list(self._colors.values())), posinf=1.0, neginf=0.0)
        colors[list(self._colors)] = rows / (255.0 if rows.max() > 1.0 else 1.0)
        return colors

    def build(self, group: _Group, axes: Axes, materials: dict[str, Material]) -> SceneObject:
        """One object; its vertices are in the world's frame already.

        Shades of its materials by the colours of its vertices are added to the materials.
        """
        points = self._all_points
        vertices = np.array(group.vertices)
        triangles, owner = triangulate(points[vertices], np.array(group.sizes))
        check_count(self._source, len(triangles))
        textures = np.array(group.textures)[triangles]
        uvs = None
        if self._uvs and (textures >= 0).any():
            uvs = self._all_uvs[np.maximum(textures, 0)]
            uvs[textures < 0] = 0.0
        slots, own = np.unique(np.array(group.slots)[owner], return_inverse=True)
        known = list(self.materials)
        names, own = [known[slot] for slot in slots], own.reshape(-1)
        if self._colors:
            colors = self._all_colors[vertices[triangles]].mean(axis=1)
            names, own = shaded_slots(colors, names, own, materials)
        mesh = make_mesh(
            group.name,
            points,
            vertices[triangles],
            uvs=uvs,
            slots=own,
            materials=names,
            linear=axes.linear,
        )
        return SceneObject(group.name, (Part(mesh),), kind="mesh")


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Words of every line with its number; a backslash at the end joins lines."""
    held: list[str] = []
    for number, line in enumerate(text.split("\n"), start=1):
        if "#" in line:
            line = _COMMENT.sub("", line)
        if line.endswith("\\"):
            held.append(line[:-1])
            if len(held) < 10_000:
                continue
            line = ""
        if held:
            line = " ".join([*held, line])
            held = []
        words = line.split()
        if words:
            yield number, words
    if held:
        yield number, " ".join(held).split() or ["#"]


def _materials(
    source: Path, libraries: list[str], context: Context, pictures: Pictures
) -> tuple[dict[str, Material], list[Path]]:
    """All materials of all libraries; those that are not found are findings."""
    index = context.index(source)
    known: dict[str, Material] = {}
    files = []
    for name in dict.fromkeys(libraries):
        found = index.find(name, (".mtl",))
        if found is None or found.suffix.lower() != ".mtl":
            context.findings.missing("file", name)
            continue
        files.append(found)
        known |= read_mtl(found, replace(pictures, source=found, files=pictures.files))
    return known, files


def read_mtl(path: Path, pictures: Pictures) -> dict[str, Material]:
    """Materials of a library; lines that make no sense are passed over."""
    known: dict[str, Material] = {}
    name = ""
    unread: dict[str, None] = {}
    read = {word.lower() for word, what in MTL_STATEMENTS.items() if what is Support.READ}
    for _, words in _lines(read_text(path, MAX_MTL_BYTES)):
        key, rest = words[0].lower(), words[1:]
        if key not in read:
            if len(unread) < MAX_NAMES:
                unread[words[0][:20]] = None
            continue
        if key == "newmtl":
            name = " ".join(rest)
            known[name] = Material(name)
        if name not in known:
            continue
        material = known[name]
        r, g, b, a = material.color
        values = _numbers(rest)
        match key:
            case "kd" if values:
                r, g, b = (values * 3)[:3] if len(values) < 3 else values[:3]
            case "d" if values:
                a = values[-1]
            case "tr" if values:
                a = 1.0 - values[-1]
            case "map_kd":
                file, repeat = _map(rest)
                material = replace(material, texture=pictures.find(file), repeat=repeat)
            case "map_d":
                mask = pictures.find(_map(rest)[0])
                if mask is not None:
                    bright = _channel(rest) in BRIGHT
                    material = replace(material, opacity=Opacity(mask, blend=True, bright=bright))
        color = tuple(min(1.0, max(0.0, value)) for value in (r, g, b, a))
        known[name] = replace(material, color=(color[0], color[1], color[2], color[3]))
    for word in unread:
        pictures.context.findings.skip("MTL statement", word)
    return {name: _lit(material) for name, material in known.items()}


def _lit(material: Material) -> Material:
    """Exporters write black under a picture that is to show as it is."""
    if material.texture is not None and max(material.color[:3]) < 1e-3:
        return replace(material, color=(1.0, 1.0, 1.0, material.color[3]))
    return material


def _numbers(words: list[str]) -> list[float]:
    found = []
    for word in words:
        try:
            value = float(word)
        except ValueError:
            continue
        if abs(value) < 1e9:
            found.append(value)
    return found


def _channel(words: list[str]) -> str:
    """The channel of a map's picture that counts: the word behind `-imfchan`, or nothing."""
    lower = [word.lower() for word in words]
    place = lower.index("-imfchan") + 1 if "-imfchan" in lower else len(lower)
    return lower[place] if place < len(lower) else ""


def _map(words: list[str]) -> tuple[str, bool]:
    """File name, and whether the picture repeats, of `-s 1 1 1 -clamp on wall paper.png`."""
    repeat = True
    while words and words[0].lower() in MAP_OPTIONS:
        option, words = words[0].lower(), words[1:]
        if option == "-clamp" and words:
            repeat = words[0].lower() != "on"
        count = MAP_OPTIONS[option]
        numeric = count > 1
        while words and count and (not numeric or _numbers(words[:1])):
            words, count = words[1:], count - 1
    return " ".join(words), repeat
