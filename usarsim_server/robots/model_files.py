"""Bodies from MJCF or URDF files: links, joints and shapes as if the robot file had them itself.

A robot file says `body = "nao.xml"`; `[joints]` gives what such files lack or say otherwise, and
`[[package]]` makes mission packages of joints. MuJoCo reads the file, so whatever it can load will
do; its masses, inertias, shapes, joints and couplings of joints are taken over, everything else in
it is left out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np

from usarsim_server.base.errors import RobotDescriptionError, at
from usarsim_server.base.files import Folders, data_directory
from usarsim_server.base.tables import Table, suggest
from usarsim_server.model_check import ALLOW_MODEL
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.coupling import coupled_position, moved
from usarsim_server.robots.description import (
    DEFAULT_TORQUE,
    ActuatorDescription,
    JointType,
    LinkDescription,
    Mesh,
    Shape,
)
from usarsim_server.robots.keys import (
    FASTEST,
    HEAVIEST,
    PART_NAME,
    RESERVED_NAMES,
    STRONGEST,
    Color,
)
from usarsim_server.robots.model_sources import ModelFile, load_model
from usarsim_server.robots.reading.limbs import DEFAULT_SPEED, read_limits
from usarsim_server.simulation.frames import IDENTITY, Pose

REST = "Joints"
"""Name of the actuator that has all joints of no package."""
SPECK = 1e-3
"""kg of a link that is there only because a body has several joints."""
SLOWEST = 1e-3
_GHOST: Color = (0.0, 0.0, 0.0, 0.0)
_KINDS = {
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_MESH): "mesh",
}


@dataclass(frozen=True, slots=True)
class Body:
    """What a model file holds."""

    shapes: tuple[Shape, ...]  # of the chassis
    actuators: tuple[ActuatorDescription, ...]
    """Packages first, as far as they do not need each other otherwise."""


@dataclass
class _Node:
    """A link under construction; `parent` is None for what sits on the chassis."""

    link: LinkDescription
    parent: str | None
    shapes: list[Shape] = field(default_factory=list)


def read_body(
    reader: Table, folder: Path, dialect: Dialect, *, allow_outside: bool = False
) -> Body | None:
    """Read the model file that a robot file names, if it names one.

    Args:
        reader: the robot file.
        folder: where relative paths start.
        dialect: decides the speed of joints that say nothing else.
        allow_outside: the model may lie outside this folder and the shipped data, and so may what
            it names.

    Raises:
        RobotDescriptionError: if the file cannot be used.
    """
    if not reader.has("body"):
        for key in ("joints", "package"):
            if reader.has(key):
                raise reader.error(key, "is about a model file", 'name one with body = "file.xml"')
        return None
    path = folder / reader.text("body")
    folders = Folders([folder, data_directory("robots")], allow_outside=allow_outside)
    refusal = folders.refusal(path, Path(reader.path))
    if refusal is not None:
        raise reader.error("body", refusal, ALLOW_MODEL)
    loaded = load_model(path, folders)
    base, nodes = _tree(loaded, path)
    links = _drives(reader.table("joints"), nodes, dialect)
    return Body(tuple(base), _group(nodes, links, _packages(reader, links)))


class _Names:
    """Names of links and joints as the wire and robot files can have them, each of them once."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._taken: set[tuple[str, str]] = set()

    def take(self, kind: str, name: str, instead: str) -> str:
        """A name of a kind in letters, digits and _; the other one if the file has none.

        Raises:
            RobotDescriptionError: if it has been taken already.
        """
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name or instead)
        if not plain[0].isalpha() or plain.lower() in RESERVED_NAMES:
            plain = f"{kind}_{plain}"
        if (kind, plain.lower()) in self._taken:
            problem = f"two {kind}s are called {plain!r}, give or take case and signs"
            raise RobotDescriptionError(at(self._path, problem, "give each its own name"))
        self._taken.add((kind, plain.lower()))
        return plain


def _tree(loaded: ModelFile, path: Path) -> tuple[list[Shape], list[_Node]]:
    """Chassis shapes and all links, parents first."""
    model = loaded.model
    root = _root(model, path)
    names = _Names(path)
    base = _shapes(model, root, IDENTITY)
    nodes: dict[str, _Node] = {}
    by_joint: dict[int, _Node] = {}
    # Where a body of the file is: on which link (None: chassis), and its pose there.
    places: dict[int, tuple[str | None, Pose]] = {root: (None, IDENTITY)}
    for body in range(root + 1, model.nbody):
        carrier, above = places[int(model.body_parentid[body])]
        pose = above @ Pose(_triple(model.body_pos[body]), _quaternion(model.body_quat[body]))
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        for joint in range(first, first + count):
            link, pose = _link(model, joint, pose, joint == first + count - 1, names, path)
            speed = loaded.speeds.get(model.joint(joint).name, math.nan)
            if not math.isnan(speed):
                link = replace(link, max_speed=min(max(speed, SLOWEST), FASTEST))
            by_joint[joint] = nodes[link.body] = _Node(link, carrier)
            carrier = link.body
        places[body] = (carrier, pose)
        (base if carrier is None else nodes[carrier].shapes).extend(_shapes(model, body, pose))
    _couple(model, by_joint, path)
    return base, list(nodes.values())


def _couple(model: mujoco.MjModel, nodes: Mapping[int, _Node], path: Path) -> None:
    """Give links the couplings of their joints, which MuJoCo also makes of `<mimic>`.

    Raises:
        RobotDescriptionError: if a joint is coupled twice, or to itself by way of others.
    """
    leaders: dict[int, int] = {}
    for number in range(model.neq):
        if model.eq_type[number] != mujoco.mjtEq.mjEQ_JOINT or not model.eq_active0[number]:
            continue
        one, other = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        raw = model.joint(one).name
        if one in leaders:
            problem = f"the joint {raw!r} is coupled to two others"
            raise RobotDescriptionError(at(path, problem, "couple it once"))
        leaders[one] = other
        follower, leader = nodes[one], nodes.get(other)
        # MuJoCo counts from the reference positions of both joints.
        reference = model.qpos0[model.jnt_qposadr[[one, other]]].tolist()
        follower.link = replace(
            follower.link,
            follows=None if leader is None else leader.link.joint,
            coupling=moved(
                model.eq_data[number, :5].tolist(),
                0.0 if leader is None else -reference[1],
                reference[0],
            ),
        )
    for joint in leaders:
        seen, here = {joint}, leaders[joint]
        while here in leaders:
            if here in seen:
                problem = f"the joint {model.joint(joint).name!r} is coupled to itself"
                raise RobotDescriptionError(at(path, problem, "let one joint of the ring be free"))
            seen.add(here)
            here = leaders[here]


def _root(model: mujoco.MjModel, path: Path) -> int:
    """The body that becomes the chassis; its place in the file does not matter."""
    roots = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0]
    if len(roots) != 1:
        raise RobotDescriptionError(
            at(path, f"{len(roots)} bodies stand in the world", "put all parts on one root body")
        )
    (root,) = roots
    first = int(model.body_jntadr[root])
    joints = model.jnt_type[first : first + int(model.body_jntnum[root])]
    if any(kind != mujoco.mjtJoint.mjJNT_FREE for kind in joints):
        problem = f"the root body {model.body(root).name!r} has a joint of its own"
        raise RobotDescriptionError(
            at(path, problem, "put what moves on a body that moves freely or not at all")
        )
    mass = float(model.body_subtreemass[root])
    if mass > HEAVIEST:
        raise RobotDescriptionError(
            at(path, f"weighs {mass:g} kg", f"at most {HEAVIEST:g} kg are allowed")
        )
    return root


def _link(
    model: mujoco.MjModel, joint: int, pose: Pose, last: bool, names: _Names, path: Path
) -> tuple[LinkDescription, Pose]:
    """One link whose frame lies at the joint, and the pose of the body in that frame.

    Args:
        model: the file.
        joint: its joint. pose: of the body, relative to what carries the link.
        last: no further joint of the same body follows; otherwise the link is a mere speck.
        names, path: for names and errors.
    """
    body = model.body(int(model.jnt_bodyid[joint]))
    kind = int(model.jnt_type[joint])
    raw = model.joint(joint).name
    if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
        raise RobotDescriptionError(
            at(path, f"the joint {raw!r} is a ball or free joint", "use hinges and slides")
        )
    body_name = body.name or f"Link{body.id}"
    name = names.take("joint", raw, f"{body_name}_joint{joint}")
    anchor = _triple(model.jnt_pos[joint])
    x, y, z = anchor
    limited = bool(model.jnt_limited[joint])
    low, high = model.jnt_range[joint].tolist()
    force = float(model.jnt_actfrcrange[joint, 1])
    link = LinkDescription(
        body=names.take("link", body_name if last else f"{body_name}_{name}", ""),
        joint=name,
        parent=None,
        type=JointType.REVOLUTE if kind == mujoco.mjtJoint.mjJNT_HINGE else JointType.PRISMATIC,
        axis=_triple(model.jnt_axis[joint]),
        pose=pose @ Pose(anchor),
        shapes=() if last else (Shape("sphere", (0.005,), IDENTITY, SPECK, _GHOST, False),),
        limits=(low, high) if limited else None,
        max_speed=math.nan,
        max_torque=min(force, STRONGEST) if force > 0.0 else math.nan,
        damping=float(np.ravel(model.dof_damping[model.jnt_dofadr[joint]])[0]),
    )
    # The file has the pose at the joint's reference position, a link has it at zero.
    reference = float(model.qpos0[model.jnt_qposadr[joint]])
    return replace(link, pose=link.placed(-reference)), Pose((-x, -y, -z))


def _shapes(model: mujoco.MjModel, body: int, pose: Pose) -> list[Shape]:
    """Shapes of a body without weight, and one without shape that has all of it."""
    found = []
    first = int(model.body_geomadr[body])
    for geom in range(first, first + int(model.body_geomnum[body])):
        kind = _KINDS.get(int(model.geom_type[geom]))
        if kind is None:
            continue
        place = Pose(_triple(model.geom_pos[geom]), _quaternion(model.geom_quat[geom]))
        collides = bool(model.geom_contype[geom] or model.geom_conaffinity[geom])
        red, green, blue, alpha = _color(model, geom)
        found.append(
            Shape(
                kind=kind,
                size=_size(kind, model.geom_size[geom].tolist()),
                pose=pose @ place,
                mass=0.0,
                color=(red, green, blue, alpha),
                collides=collides,
                mesh=_mesh(model, int(model.geom_dataid[geom])) if kind == "mesh" else None,
            )
        )
    if model.body_mass[body] > 0.0:
        found.append(_weight(model, body, pose))
    return found


def _weight(model: mujoco.MjModel, body: int, pose: Pose) -> Shape:
    """The box that has the mass and the moments of inertia of a body."""
    mass = float(model.body_mass[body])
    a, b, c = model.body_inertia[body].tolist()
    squares = (6.0 * (b + c - a) / mass, 6.0 * (a + c - b) / mass, 6.0 * (a + b - c) / mass)
    x, y, z = (math.sqrt(max(square, 1e-6)) for square in squares)
    place = Pose(_triple(model.body_ipos[body]), _quaternion(model.body_iquat[body]))
    return Shape("box", (x, y, z), pose @ place, mass, _GHOST, collides=False)


def _size(kind: str, size: Sequence[float]) -> tuple[float, ...]:
    match kind:
        case "box":
            return size[0] * 2.0, size[1] * 2.0, size[2] * 2.0
        case "cylinder" | "capsule":
            return size[0], size[1] * 2.0
        case "sphere":
            return (size[0],)
        case "mesh":
            return ()
        case _:
            return size[0], size[1], size[2]


def _mesh(model: mujoco.MjModel, number: int) -> Mesh:
    first, count = int(model.mesh_vertadr[number]), int(model.mesh_vertnum[number])
    start, faces = int(model.mesh_faceadr[number]), int(model.mesh_facenum[number])
    return Mesh(
        model.mesh_vert[first : first + count].astype(np.float64),
        model.mesh_face[start : start + faces].astype(np.intc),
    )


def _color(model: mujoco.MjModel, geom: int) -> Color:
    material = int(model.geom_matid[geom])
    values = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    red, green, blue, alpha = values.tolist()
    return red, green, blue, alpha


def _drives(table: Table, nodes: Sequence[_Node], dialect: Dialect) -> dict[str, LinkDescription]:
    """Links by joint with what the robot file says about their drives."""
    speed = table.number("max_speed", DEFAULT_SPEED[dialect], low=SLOWEST, high=FASTEST)
    torque = table.number("max_torque", DEFAULT_TORQUE, low=SLOWEST, high=STRONGEST)
    damping = table.number("damping", -1.0, low=0.0, high=STRONGEST)
    done = {}
    for node in nodes:
        link = node.link
        own = table.table(link.joint)
        limits = read_limits(own, link.limits)
        low, high = limits or (-FASTEST, FASTEST)
        done[link.joint] = replace(
            link,
            limits=limits,
            max_speed=own.number(
                "max_speed",
                speed if math.isnan(link.max_speed) else link.max_speed,
                low=SLOWEST,
                high=FASTEST,
            ),
            max_torque=own.number(
                "max_torque",
                torque if math.isnan(link.max_torque) else link.max_torque,
                low=SLOWEST,
                high=STRONGEST,
            ),
            damping=own.number(
                "damping", link.damping if damping < 0.0 else damping, low=0.0, high=STRONGEST
            ),
            home=own.number("home", min(max(0.0, low), high), low=low, high=high),
            follows=own.text("follows", "") or link.follows,
            coupling=None if own.has("follows") else link.coupling,
            shapes=(*link.shapes, *node.shapes),
        )
        if done[link.joint].coupling is not None and own.has("home"):
            raise own.error("home", "is that of a coupled joint", "give its leader a home")
        own.finish()
    table.finish()
    return _at_home(done)


def _at_home(links: Mapping[str, LinkDescription]) -> dict[str, LinkDescription]:
    """Links by joint, coupled ones at home where their leaders' homes put them."""
    found = dict(links)
    for joint, link in links.items():
        chain, leader = [joint], link.follows
        while found[chain[-1]].coupling is not None and leader is not None:
            chain.append(leader)
            leader = found[leader].follows
        for name in reversed(chain):
            one = found[name]
            if one.coupling is not None:
                above = 0.0 if one.follows is None else found[one.follows].home
                found[name] = replace(one, home=coupled_position(one.coupling, above))
    return found


def _packages(reader: Table, links: Mapping[str, LinkDescription]) -> dict[str, str]:
    """The mission packages that joints belong to."""
    package_of: dict[str, str] = {}
    for table in reader.tables("package") if reader.has("package") else ():
        name, joints = table.text("name"), table.texts("joints")
        if not PART_NAME.fullmatch(name) or name == REST:
            raise table.error("name", f"is {name!r}", f"use letters, digits and _, not {REST}")
        if not joints:
            raise table.error("joints", "names no joint", 'write joints = ["..."]')
        for joint in joints:
            if joint not in links:
                raise table.error("joints", f"no joint {joint!r}", suggest(joint, list(links)))
            if joint in package_of:
                raise table.error("joints", f"{joint!r} is in a package already", "name it once")
            package_of[joint] = name
        table.finish()
    return package_of


def _group(
    nodes: Sequence[_Node], links: Mapping[str, LinkDescription], package_of: Mapping[str, str]
) -> tuple[ActuatorDescription, ...]:
    """Make actuators: the packages, and one or more of what is left.

    Links of a package that do not hang together make several actuators; all but the first are
    numbered.
    """
    joint_of = {node.link.body: node.link.joint for node in nodes}
    made: dict[tuple[str, str | None], list[LinkDescription]] = {}
    key_of: dict[str, tuple[str, str | None]] = {}
    for node in nodes:
        joint = node.link.joint
        above = None if node.parent is None else joint_of[node.parent]
        name = package_of.get(joint, REST)
        if above is not None and package_of.get(above, REST) == name:
            key = key_of[above]
            numbers = [link.body for link in made[key]]
            parent = numbers.index(links[above].body)
        else:
            key, parent = (name, node.parent), None
        key_of[joint] = key
        made.setdefault(key, []).append(replace(links[joint], parent=parent))
    names = [name for name, _ in made]
    actuators = []
    for number, ((name, mount), chain) in enumerate(made.items()):
        again = names[:number].count(name)
        actuators.append(
            ActuatorDescription(
                name=f"{name}{again + 1}" if again else name,
                mount=mount,
                pose=IDENTITY,
                links=tuple(chain),
                package=name != REST,
            )
        )
    return tuple(actuators)


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _quaternion(values: np.ndarray) -> tuple[float, float, float, float]:
    w, x, y, z = values.tolist()
    return w, x, y, z
