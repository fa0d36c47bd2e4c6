"""Loading MJCF and URDF files with MuJoCo, whatever their makers' habits with meshes are."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from usarsim_server.base.errors import RobotDescriptionError, at
from usarsim_server.base.files import Folders, is_regular, named, read_regular, reason
from usarsim_server.base.toml import decoded
from usarsim_server.model_check import ALLOW_MODEL, check_model
from usarsim_server.specs import path_bytes, read_spec

LARGEST_TEXT = 16 * 2**20
"""Bytes of a model file; descriptions of robots are some ten kilobytes long."""
LARGEST_MESHES = 256 * 2**20
"""Bytes of all mesh files together."""
MOST_TRIANGLES = 500_000
"""Of all meshes together; they are copied into the world once for every slot."""
MOST_BODIES = 300
"""No machine of this kind has more; work grows with the square of their number."""

_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_FIRST_ELEMENT = re.compile(r"<([A-Za-z_][\w.-]*)")
_DISCARD = re.compile(r"\bdiscardvisual\s*=\s*(\"[^\"]*\"|'[^']*')")
_TAG = re.compile(r"<(/?)(joint|limit)\b((?:[^<>\"']|\"[^\"]*\"|'[^']*')*+)>")
_ATTRIBUTE = re.compile(r"\b(name|velocity)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_SCHEME = re.compile(r"(package|model|file)://*")


@dataclass(frozen=True, slots=True, eq=False)
class ModelFile:
    """What is in a model file."""

    model: mujoco.MjModel
    speeds: Mapping[str, float]
    """Largest speeds, rad/s or m/s, of the joints whose `<limit>` in a URDF file says one."""


def load_model(path: Path, folders: Folders) -> ModelFile:
    """Read and compile a model file.

    A URDF file keeps its fixed links and its visual shapes, which MuJoCo would otherwise leave
    out. Meshes of ROS packages (`package://name/meshes/x.stl`) are looked for beside the file, in
    the folders above it, and in folders called `meshes` there.

    Args:
        path: of the file.
        folders: out of which it, and what it names, may be read.

    Raises:
        RobotDescriptionError: if it cannot be read or is no model, is too large, or names files
            outside.
    """
    text = _text(path)
    speeds: Mapping[str, float] = {}
    check_model(path, folders, RobotDescriptionError)
    try:
        if _is_urdf(text):
            spec = mujoco.MjSpec.from_string(_with_visuals(text))
            spec.modelfiledir = path_bytes(path.parent)
            spec.compiler.fusestatic = False
            speeds = _speeds(text)
        else:
            spec = read_spec(path)
        _find_meshes(spec, path, folders)
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        problem = " ".join(str(error).split())
        raise RobotDescriptionError(
            at(path, f"MuJoCo cannot use it: {problem}", "try it in MuJoCo's own viewer")
        ) from None
    _refuse_nonsense(path, model)
    _refuse_too_many(path, model.nbody, MOST_BODIES, "bodies")
    _refuse_too_many(path, model.nmeshface, MOST_TRIANGLES, "triangles")
    return ModelFile(model, speeds)


def _speeds(text: str) -> dict[str, float]:
    """Speeds of the joints of a URDF file, which MuJoCo leaves out; 0 is how exporters say none."""
    speeds: dict[str, float] = {}
    joint = ""
    for found in _TAG.finditer(_COMMENT.sub("", text)):
        end, tag, inside = found.groups()
        said = {key: one or other for key, one, other in _ATTRIBUTE.findall(inside)}
        if tag == "joint":
            joint = "" if end or inside.endswith("/") else said.get("name", "")
        elif joint and not end:
            try:
                speed = float(said.get("velocity", "0"))
            except ValueError:
                continue
            if 0.0 < speed < math.inf:
                speeds[joint] = speed
    return speeds


def _text(path: Path) -> str:
    try:
        return decoded(read_regular(path, LARGEST_TEXT), path, RobotDescriptionError)
    except OSError as error:
        problem = f"cannot be read: {reason(error)}"
        raise RobotDescriptionError(
            at(path, problem, "check body = ... of the robot file")
        ) from None


def _is_urdf(text: str) -> bool:
    first = _FIRST_ELEMENT.search(_COMMENT.sub("", text))
    return first is not None and first[1] == "robot"


def _with_visuals(text: str) -> str:
    """The text of a URDF file with the order to MuJoCo to keep shapes that are only seen."""
    text = _DISCARD.sub("", _COMMENT.sub("", text))
    keep = 'discardvisual="false"'
    for pattern, insert in (
        (r"<compiler\b", rf"\g<0> {keep}"),
        (r"<mujoco[^>]*[^/>]>|<mujoco>", rf"\g<0><compiler {keep}/>"),
        (r"<mujoco[^>]*/>", rf"<mujoco><compiler {keep}/></mujoco>"),
    ):
        if re.search(pattern, text):
            return re.sub(pattern, insert, text, count=1)
    extra = rf"\g<0><mujoco><compiler {keep}/></mujoco>"
    return re.sub(r"<robot\b[^>]*>", extra, text, count=1)


def _find_meshes(spec: mujoco.MjSpec, path: Path, folders: Folders) -> None:
    """Replace addresses of mesh files by names that MuJoCo finds; refuse far too large ones."""
    total = 0
    for mesh in spec.meshes:
        if not mesh.file:
            continue
        place = _SCHEME.match(mesh.file)
        found = path.parent / named(spec.meshdir) / named(mesh.file)
        if place is not None or not is_regular(found):
            found = _search(path.parent, named(mesh.file[place.end() if place else 0 :])) or found
            refusal = folders.refusal(found, path)
            if refusal is not None:
                raise RobotDescriptionError(at(path, refusal, ALLOW_MODEL))
            if is_regular(found):
                mesh.file = path_bytes(found.resolve())
        total += found.stat().st_size if is_regular(found) else 0
    if total > LARGEST_MESHES:
        problem = f"its meshes are larger than {LARGEST_MESHES // 2**20} MB"
        raise RobotDescriptionError(at(path, problem, "simplify them"))


def _search(folder: Path, name: str) -> Path | None:
    """A file of this name, or of the end of this name, near a folder."""
    parts = Path(name).parts
    for above in (folder, *folder.parents[:2]):
        for first in range(len(parts)):
            for root in (above, above / "meshes"):
                found = root.joinpath(*parts[first:])
                if is_regular(found):
                    return found
    return None


def _refuse_nonsense(path: Path, model: mujoco.MjModel) -> None:
    """MuJoCo reads `nan` as a number."""
    for field in ("body_pos", "body_quat", "body_inertia", "jnt_pos", "jnt_range", "geom_pos"):
        if not np.isfinite(getattr(model, field)).all():
            raise RobotDescriptionError(
                at(path, f"{field} is not finite somewhere", "write ordinary numbers")
            )


def _refuse_too_many(path: Path, count: int, most: int, what: str) -> None:
    if count > most:
        raise RobotDescriptionError(
            at(path, f"has {count} {what}, at most {most} are allowed", "simplify it")
        )
