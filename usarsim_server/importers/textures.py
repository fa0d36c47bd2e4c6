"""Pictures of materials: whatever Pillow reads becomes PNG, of bounded size."""

from __future__ import annotations

import hashlib
import io
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from usarsim_server.importers.findings import Findings
from usarsim_server.importers.names import NameBook
from usarsim_server.importers.scene import Color, Material

__all__ = ["NEUTRAL", "Finish", "finish_materials"]

NEUTRAL: Color = (0.62, 0.62, 0.60, 1.0)
"""Colour of what has no material."""

LARGEST = 2048
"""Pixels along the longer side of a picture."""

MAX_PIXELS = 64 << 20
"""Larger pictures are not opened: 64 megapixels take 192 MB."""


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


def _open(material: Material, findings: Findings) -> Image.Image | None:
    source: Path | io.BytesIO
    if material.image is not None:
        source, name = io.BytesIO(material.image), material.name
    elif material.texture is not None:
        source, name = material.texture, str(material.texture)
        if not material.texture.is_file():
            findings.missing("texture", material.texture.name)
            return None
    else:
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image = Image.open(source)
            if image.width * image.height > MAX_PIXELS:
                findings.warn(name, f"{image.width} x {image.height} pixels are too many; left out")
                return None
            image.draft("RGB", (LARGEST, LARGEST))
            image.thumbnail((LARGEST, LARGEST))
            return image.convert("RGB")
    except Exception as error:  # Pillow's decoders raise whatever they like
        findings.warn(name, f"the picture cannot be read ({type(error).__name__}: {error})")
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
