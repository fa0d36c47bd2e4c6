"""Fixed pieces that a scene keeps in files of their own, which are compiled once.

The importer of maps writes what collides into `solids/`: files with nothing but geoms of the world
and their meshes, each attached to the world body of `scene.xml` by one frame without a pose. For
MuJoCo they are a part of the scene, and a small world is compiled with them. Of a large one each of
these files is compiled apart (`read_apart`); its models are joined to that of the rest.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from usarsim_server.base.files import named, read_regular
from usarsim_server.simulation.raw import understood
from usarsim_server.simulation.splice import FixedPart
from usarsim_server.specs import read_spec, text_bytes

LEAST = 8000
"""Geoms in such files from which on they are compiled apart; 8,000 are compiled in 0.3 to 0.7 s."""
_DECLARED = re.compile(r"<!(?!--)")
_GEOM = re.compile(rb"<geom[\s/>]")


def read_apart(scene: Path) -> tuple[mujoco.MjSpec, FixedPart] | None:
    """A scene without its files of fixed pieces, and these pieces.

    Args:
        scene: which has been looked through (`model_check`).

    Returns:
        None if there are few of them, or if they hold something else.

    Raises:
        ValueError: MuJoCo cannot read or compile it.
        OSError: a file cannot be read.
    """
    text = read_regular(scene).decode("utf-8-sig", "replace")
    if "<attach" not in text or _DECLARED.search(text):
        return None
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError:
        return None  # MuJoCo says what is wrong
    files = _take_out(root, scene.parent)
    pieces = sum(len(_GEOM.findall(read_regular(file))) for file in files)
    if pieces < LEAST or not understood():
        return None
    try:
        fixed = FixedPart([read_spec(file).compile() for file in files])
    except ValueError:
        return None
    text = ElementTree.tostring(root, encoding="unicode")
    return mujoco.MjSpec.from_string(text_bytes(text)), fixed


def _take_out(root: ElementTree.Element, folder: Path) -> list[Path]:
    """Take files of fixed pieces out of a scene, whose other files are named from anywhere."""
    compilers = root.findall("compiler") or [ElementTree.SubElement(root, "compiler")]
    for compiler in compilers:
        for key in ("meshdir", "texturedir"):
            place = compiler.get(key, compiler.get("assetdir", ""))
            compiler.set(key, str(folder / place))
    models = {
        str(one.get("name")): (assets, one)
        for assets in root.findall("asset")
        for one in assets.findall("model")
    }
    uses = Counter(one.get("model", "") for one in root.iter("attach"))
    found = []
    for world in root.findall("worldbody"):
        for frame in world.findall("frame"):
            inside = list(frame)
            if frame.attrib or [one.tag for one in inside] != ["attach"]:
                continue
            attach = inside[0]
            name = attach.get("model", "")
            if uses[name] > 1 or name not in models or attach.attrib.keys() - {"model", "prefix"}:
                continue
            assets, model = models[name]
            if model.attrib.keys() != {"name", "file"}:
                continue
            found.append(folder / named(str(model.get("file"))))
            assets.remove(model)
            world.remove(frame)
    return found
