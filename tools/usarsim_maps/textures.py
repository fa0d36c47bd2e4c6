"""Pictures of materials: whatever Pillow reads becomes PNG, of bounded size.

A scene seen in a mirror: y becomes -y. For maps whose handedness was lost on the way.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from usarsim_maps.findings import Findings
from usarsim_maps.scene import (
    Brush,
    Color,
    Heightfield,
    Material,
    Part,
    Polygon,
    Scene,
    SceneObject,
)
from usarsim_maps.sheet import NameBook
from usarsim_maps.units import MIRROR
from usarsim_server.errors import MapImportError, at
from usarsim_server.files import is_regular, open_regular
from usarsim_server.simulation.frames import Pose, Vector

NEUTRAL: Color = (0.62, 0.62, 0.60, 1.0)
"""Colour of what has no material."""

LARGEST = 2048
"""Pixels along the longer side of a picture."""

MAX_PIXELS = 64 << 20
"""Larger pictures are not opened: 64 megapixels take 192 MB."""

FORMATS = ("PNG", "JPEG", "TGA", "DDS", "BMP", "TIFF", "WEBP", "GIF", "PPM", "MPO")
"""That are decoded, whatever the name says. Pillow knows some that start other programs."""


@dataclass(frozen=True, slots=True)
class Finish:
    """A material as it goes into the scene.

    Attributes:
        name: unique and safe.
        color: multiplies the picture.
        picture: file name below `textures/`, None without one.
        mean: colour of the picture as a whole, times `color`; for plans and previews.
    """

    name: str
    color: Color
    picture: str | None
    mean: Color


def finish_materials(
    materials: Mapping[str, Material], used: list[str], folder: Path, findings: Findings
) -> dict[str, Finish]:
    """Write the pictures of all used materials into a folder, each different picture once.

    Args:
        materials: of the scene.
        used: names that are used, in order; unknown ones become neutral grey.
        folder: `textures/` of the world; made if there is something to put into it.
        findings: told about missing and unreadable pictures.
    """
    book = NameBook()
    written: dict[str, str] = {}
    answer: dict[str, Finish] = {}
    for name in used:
        material = materials.get(name)
        if material is None:
            material = Material(name, NEUTRAL)
        picture, mean = None, material.color
        image = _open(material, findings)
        if image is not None:
            picture, shade = _write(image, folder, written)
            r, g, b, a = material.color
            mean = (r * shade[0], g * shade[1], b * shade[2], a)
        color = tuple(min(1.0, max(0.0, c)) for c in material.color)
        answer[name] = Finish(
            book.take(name or "plain"), (color[0], color[1], color[2], color[3]), picture, mean
        )
    return answer


@contextlib.contextmanager
def open_picture(source: Path | bytes, name: str, most: int = MAX_PIXELS) -> Iterator[Image.Image]:
    """A picture while it is open; its pixels are not decoded before somebody asks for them.

    Args:
        source: a file, or what is in it.
        name: for errors.
        most: pixels that it may have.

    Raises:
        MapImportError: it cannot be opened, has more pixels, or, while it is open, is damaged.
    """
    cure = "save it again as PNG"
    try:
        with (
            warnings.catch_warnings(),
            io.BytesIO(source) if isinstance(source, bytes) else open_regular(source) as file,
            Image.open(file, formats=FORMATS) as image,
        ):
            warnings.simplefilter("ignore")
            if image.width * image.height > most:
                problem = f"{image.width} x {image.height} pixels are too many"
                raise MapImportError(at(name, problem, "reduce the picture"))
            yield image
    except MapImportError:
        raise
    except Image.DecompressionBombError:
        raise MapImportError(at(name, "far too many pixels", "reduce the picture")) from None
    except Exception as error:  # Pillow's decoders raise whatever they like
        text = f"the picture cannot be read ({type(error).__name__}: {error})"
        raise MapImportError(at(name, " ".join(text.split())[:300], cure)) from None


def _open(material: Material, findings: Findings) -> Image.Image | None:
    source = material.image if material.image is not None else material.texture
    if source is None:
        return None
    if isinstance(source, Path) and not is_regular(source):
        findings.missing("texture", source.name)
        return None
    try:
        with open_picture(source, material.name) as image:
            image.draft("RGB", (LARGEST, LARGEST))
            image.thumbnail((LARGEST, LARGEST))
            return image.convert("RGB")
    except MapImportError as error:
        findings.warn(str(material.texture or material.name), f"{error}; left out")
        return None


def _write(
    image: Image.Image, folder: Path, written: dict[str, str]
) -> tuple[str, tuple[float, float, float]]:
    pixels = image.tobytes()
    digest = hashlib.sha256(str(image.size).encode() + pixels).hexdigest()[:16]
    if digest not in written:
        folder.mkdir(parents=True, exist_ok=True)
        written[digest] = f"{digest}.png"
        image.save(folder / written[digest], optimize=False, compress_level=4)
    small = image.resize((1, 1), Image.Resampling.BOX).getpixel((0, 0))
    assert isinstance(small, tuple)
    return written[digest], (small[0] / 255.0, small[1] / 255.0, small[2] / 255.0)


Array = NDArray[np.float64]

MIRROR4 = np.diag([1.0, -1.0, 1.0, 1.0])


def reflect(scene: Scene) -> Scene:
    """The mirror image of a scene; faces still look outwards, headings turn the other way."""
    smoke = scene.smoke
    return replace(
        scene,
        source=replace(scene.source, mirrored=not scene.source.mirrored),
        objects=tuple(map(_object, scene.objects)),
        brushes=tuple(map(_brush, scene.brushes)),
        heightfields=tuple(map(_heightfield, scene.heightfields)),
        starts=tuple(replace(s, pose=_pose(s.pose), turns=-s.turns) for s in scene.starts),
        path_nodes=tuple(replace(n, position=_point(n.position)) for n in scene.path_nodes),
        victims=tuple(replace(victim, pose=_pose(victim.pose)) for victim in scene.victims),
        lights=tuple(
            replace(light, position=_point(light.position), direction=_point(light.direction))
            for light in scene.lights
        ),
        smoke=replace(
            smoke,
            volumes=tuple(replace(v, pose=_pose(v.pose)) for v in smoke.volumes),
            puffs=tuple(replace(p, position=_point(p.position)) for p in smoke.puffs),
        ),
    )


def _point(point: Vector) -> Vector:
    x, y, z = point
    return x, -y, z


def _pose(pose: Pose) -> Pose:
    """S R S: turns about z and x change their sense."""
    w, i, j, k = pose.quaternion
    return Pose(_point(pose.position), (w, -i, j, -k))


def _object(thing: SceneObject) -> SceneObject:
    parts = tuple(_part(part) for part in thing.parts)
    return replace(thing, pose=_pose(thing.pose), parts=parts)


def _part(part: Part) -> Part:
    # S (pose matrix) = (S pose S) (S matrix); the builder turns faces round where it mirrors.
    return replace(part, matrix=MIRROR4 @ part.matrix)


def _brush(brush: Brush) -> Brush:
    return replace(brush, polygons=tuple(map(_polygon, brush.polygons)))


def _polygon(polygon: Polygon) -> Polygon:
    vertices: Array = (polygon.vertices @ MIRROR)[::-1]
    return replace(
        polygon, vertices=vertices, uvs=None if polygon.uvs is None else polygon.uvs[::-1]
    )


def _heightfield(field: Heightfield) -> Heightfield:
    """Rows run along +y again, from what was the last one."""
    length = (len(field.heights) - 1) * field.spacing[1]
    return replace(
        field,
        heights=field.heights[::-1],
        pose=_pose(field.pose) @ Pose((0.0, -length, 0.0)),
    )
