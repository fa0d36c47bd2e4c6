"""Lights of SDF, and materials of its visuals: colours, pictures, Gazebo's names, OGRE scripts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from usarsim_maps.files import read_text
from usarsim_maps.gazebo.elements import LIGHT, MATERIAL, Elements
from usarsim_maps.gazebo.files import GazeboFiles
from usarsim_maps.gazebo.frames import flag
from usarsim_maps.meshes.mesh_files import PICTURES, Pictures
from usarsim_maps.meshes.xml_text import Document, Node
from usarsim_maps.scene import NEUTRAL, Array, Color, Light, LightKind, Material, Mesh, Shape
from usarsim_server.base.errors import MapImportError
from usarsim_server.base.files import is_regular

MAX_SCRIPT_BYTES = 4 << 20

OWN_SCRIPT = "gazebo.material"
"""Script with Gazebo's own materials, whose colours are below; no map brings it along."""

RGB = tuple[float, float, float]

COLORS: dict[str, RGB] = {
    "grey": (0.7, 0.7, 0.7),
    "gray": (0.7, 0.7, 0.7),
    "darkgrey": (0.18, 0.18, 0.18),
    "darkgray": (0.18, 0.18, 0.18),
    "white": (1.0, 1.0, 1.0),
    "flatblack": (0.1, 0.1, 0.1),
    "black": (0.0, 0.0, 0.0),
    "red": (1.0, 0.0, 0.0),
    "redbright": (0.87, 0.26, 0.07),
    "green": (0.0, 1.0, 0.0),
    "blue": (0.0, 0.0, 1.0),
    "skyblue": (0.13, 0.44, 0.70),
    "yellow": (1.0, 1.0, 0.0),
    "zincyellow": (0.97, 0.95, 0.21),
    "darkyellow": (0.7, 0.7, 0.0),
    "purple": (1.0, 0.0, 1.0),
    "turquoise": (0.0, 1.0, 1.0),
    "torquoise": (0.0, 1.0, 1.0),
    "orange": (1.0, 0.51, 0.05),
    "darkorange": (0.83, 0.33, 0.0),
    "indigo": (0.33, 0.0, 0.5),
    "darkmagenta": (0.55, 0.0, 0.55),
    "gold": (0.8, 0.65, 0.12),
    "bronze": (0.71, 0.43, 0.18),
    "wood": (0.55, 0.40, 0.25),
    "woodfloor": (0.60, 0.45, 0.30),
    "woodpallet": (0.65, 0.52, 0.36),
    "woodtile": (0.58, 0.42, 0.28),
    "bricks": (0.55, 0.30, 0.24),
    "brick": (0.55, 0.30, 0.24),
    "road": (0.25, 0.25, 0.27),
    "residential": (0.45, 0.45, 0.45),
    "grass": (0.30, 0.45, 0.20),
    "ceilingtiled": (0.85, 0.85, 0.82),
    "paintedwall": (0.80, 0.78, 0.72),
    "cloudysky": (0.60, 0.70, 0.80),
    "checkergreen": (0.3, 0.6, 0.3),
}
"""Gazebo's own materials, those with a picture as its mean colour; words in front do not count."""

DOWN = np.array([0.0, 0.0, -1.0])

BRIGHTEST = 0.6
"""Directional light that a surface gets at most: the server's own light adds to it."""


def sun() -> Light:
    """The light of `model://sun`, which is not on disk: high, from the side."""
    return Light("sun", LightKind.DIRECTIONAL, (0.0, 0.0, 10.0), (-0.5, 0.1, -0.9))


def light_of(document: Document, node: Node, matrix: Array, unit: float) -> Light:
    """The light of an element, whose pose in the world is a matrix (4, 4); metres per unit.

    Suns cast no shadows: over a large map the grain of the shadows would show.
    """
    Elements(document.findings).count(node, LIGHT, node.get("name"))
    kinds = {"directional": LightKind.DIRECTIONAL, "spot": LightKind.SPOT}
    kind = kinds.get(node.get("type"), LightKind.POINT)
    diffuse = document.vector_or(node.child("diffuse"), np.ones(3), 3, 4)[:3]
    strength = float(diffuse.max())
    color = diffuse / strength if strength > 0.0 else np.ones(3)
    r, g, b = np.clip(color, 0.0, 1.0).tolist()
    direction = document.vector_or(node.child("direction"), DOWN, 3)
    if not np.linalg.norm(direction) > 1e-9:
        direction = DOWN
    dx, dy, dz = (matrix[:3, :3] @ direction).tolist()
    x, y, z = matrix[:3, 3].tolist()
    reach = document.number(node.child("attenuation", "range")) or 0.0
    cone = document.number(node.child("spot", "outer_angle"))
    intensity = document.number(node.child("intensity"))
    if not flag(node.word("light_on"), True):
        intensity = 0.0
    return Light(
        name=node.get("name") or "light",
        kind=kind,
        position=(x, y, z),
        direction=(dx, dy, dz),
        color=(r, g, b),
        brightness=min(10.0, max(0.0, strength * (1.0 if intensity is None else intensity))),
        reach=max(0.0, reach) * unit if kind is not LightKind.DIRECTIONAL else 0.0,
        cone=min(90.0, max(1.0, float(np.degrees(cone or np.pi / 2.0)) / 2.0)),
        shadows=kind is LightKind.SPOT and flag(node.word("cast_shadows"), False),
    )


def dimmed(lights: Sequence[Light]) -> list[Light]:
    """Lights with the directional ones made weaker together, where they add up to plain white.

    Worlds have many suns, one from each side or several from above; screens know no more than
    white, and MuJoCo does not adapt to brightness.
    """
    suns = [light for light in lights if light.kind is LightKind.DIRECTIONAL]
    if not suns:
        return list(lights)
    ways = np.array([light.direction for light in suns])
    ways = ways / np.maximum(np.linalg.norm(ways, axis=1), 1e-12)[:, None]
    strength = np.array([light.brightness for light in suns])
    sides = np.concatenate([np.eye(3), -np.eye(3)])
    most = float((np.maximum(ways @ sides.T, 0.0) * strength[:, None]).sum(axis=0).max())
    factor = min(1.0, BRIGHTEST / most) if most > 0.0 else 1.0
    return [
        replace(light, brightness=light.brightness * factor)
        if light.kind is LightKind.DIRECTIONAL
        else light
        for light in lights
    ]


@dataclass(slots=True)
class Looks:
    """Collects the materials of one import."""

    files: GazeboFiles  # finds scripts and pictures
    materials: dict[str, Material] = field(default_factory=dict)  # by the names that parts use
    _scripts: dict[Path, dict[str, tuple[Color, str]]] = field(default_factory=dict)

    def of_visual(self, document: Document, visual: Node) -> tuple[str | None, float]:
        """Name of a visual's own material, None if it has none, and its opacity from 0 to 1."""
        node = visual.child("material")
        shown = 1.0 - min(1.0, max(0.0, document.number(visual.child("transparency")) or 0.0))
        material = None if node is None else self._material(document, node)
        return None if material is None else self.add(material), shown

    def by_slot(self, shape: Shape, material: str | None, opacity: float) -> dict[int, str]:
        """Materials of a visual by slot of its shape: its own one covers all slots of a mesh.

        Opacity below 1 takes from that of each material; what has none is neutral grey.
        """
        own = shape.materials if isinstance(shape, Mesh) else ()
        names = [material if material is not None else name for name in own or ("",)]
        if opacity < 1.0:
            return {slot: self._clear(name or "", opacity) for slot, name in enumerate(names)}
        return {} if material is None else dict.fromkeys(range(len(names)), material)

    def _clear(self, name: str, opacity: float) -> str:
        """A material as clear as a visual makes it."""
        plain = self.materials.get(name, Material("neutral", NEUTRAL))
        r, g, b, a = plain.color
        label = f"{plain.name}-{opacity:.2f}"
        return self.add(replace(plain, name=label, color=(r, g, b, a * opacity), meant=True))

    def add(self, material: Material, stem: str = "") -> str:
        """Enter a material; where its name is taken it gets another one, with the stem behind."""
        name = material.name
        number = 1
        while name in self.materials and replace(material, name=name) != self.materials[name]:
            number += 1
            name = (
                f"{material.name}@{stem}" if number == 2 and stem else f"{material.name}-{number}"
            )
        self.materials[name] = replace(material, name=name)
        return name

    def _material(self, document: Document, node: Node) -> Material | None:
        Elements(self.files.context.findings).count(node, MATERIAL)
        picture = node.word("pbr", "metal", "albedo_map") or node.word(
            "pbr", "specular", "albedo_map"
        )
        color = self._color(document, node.child("diffuse")) or self._color(
            document, node.child("ambient")
        )
        if picture:
            found = self.files.file(picture, document.path)
            if found is None:
                found = Pictures(document.path, self.files.context).find(picture)
            name = Path(picture).stem
            return Material(name, color or (1.0, 1.0, 1.0, 1.0), found)
        script = node.child("script")
        if script is not None:
            found_script = self._script(document, script)
            if found_script is not None:
                return found_script
        if color is None:
            return None
        return Material("color_" + "_".join(f"{value:.2f}" for value in color), color)

    def _color(self, document: Document, node: Node | None) -> Color | None:
        found = document.vector(node, 3, 4)
        if found is None:
            return None
        r, g, b, *alpha = found.clip(0.0, 1.0).tolist()
        return r, g, b, alpha[0] if alpha else 1.0

    def _script(self, document: Document, script: Node) -> Material | None:
        name = script.word("name")
        if not name:
            return None
        folders: list[Path] = []
        for uri in script.all("uri"):
            if uri.text.endswith(OWN_SCRIPT):
                continue
            place = self.files.find(uri.text, document.path)
            if place is None:
                continue
            if place.is_dir():
                folders.append(place)
            scripts = sorted(place.glob("*.material")) if place.is_dir() else [place]
            for path in scripts:
                if not self.files.context.admit(path, document.path):
                    continue
                found = self._read(path).get(name)
                if found is not None:
                    color, picture = found
                    texture = self._picture(picture, path, folders, script, document)
                    if texture is not None and max(color[:3]) < 0.05:
                        color = (1.0, 1.0, 1.0, color[3])
                    return Material(name, color, texture)
        return Material(name, named_color(name))

    def _read(self, path: Path) -> dict[str, tuple[Color, str]]:
        if path not in self._scripts:
            try:
                self._scripts[path] = read_script(read_text(path, MAX_SCRIPT_BYTES))
            except MapImportError as error:
                self.files.context.findings.warn(path.name, str(error))
                self._scripts[path] = {}
        return self._scripts[path]

    def _picture(
        self, name: str, path: Path, folders: list[Path], script: Node, document: Document
    ) -> Path | None:
        if not name:
            return None
        later = [self.files.find(uri.text, document.path) for uri in script.all("uri")]
        places = [place for place in (*folders, *later) if place is not None and place.is_dir()]
        for folder in (*places, path.parent.parent / "textures"):
            found = folder / name
            if found.suffix.lower() in PICTURES and is_regular(found):
                return self.files.keep(found, path)
        finder = Pictures(path, self.files.context)
        found_at = finder.find(name)
        self.files.files.extend(finder.files)
        return found_at


def named_color(name: str) -> Color:
    """The colour of one of Gazebo's own materials; grey for names that are unknown."""
    word = re.sub(r"[^a-z]", "", name.lower().rpartition("/")[2])
    alpha = 0.5 if "transparent" in word else 1.0
    word = re.sub(r"(transparent)?(overlay)?(glow)?$", "", word)
    return (*COLORS.get(word, (0.7, 0.7, 0.7)), alpha)


def read_script(text: str) -> dict[str, tuple[Color, str]]:
    """Colour and picture of every material of an OGRE script; only the first pass counts."""
    found: dict[str, tuple[Color, str]] = {}
    name = ""
    text = re.sub(r"/\*[\s\S]*?(?:\*/|\Z)", " ", text)
    for line in re.sub(r"([{}])", r"\n\1\n", text).split("\n"):
        words = line.partition("//")[0].split()
        if len(words) < 2:
            continue
        key = words[0].lower()
        if key == "material":
            head, _, parent = " ".join(words[1:]).partition(":")
            name = head.strip()
            found[name] = found.get(parent.strip(), ((0.7, 0.7, 0.7, 1.0), ""))
        elif name and key == "diffuse":
            try:
                values = [min(1.0, max(0.0, float(word))) for word in words[1:5]]
            except ValueError:
                continue
            if len(values) >= 3:
                alpha = values[3] if len(values) > 3 else 1.0
                found[name] = ((values[0], values[1], values[2], alpha), found[name][1])
        elif name and key == "texture" and not found[name][1]:
            found[name] = (found[name][0], words[1].strip('"'))
    return found
