"""What Unreal's names mean to a robot world, whatever file they come from (worlds reference 3).

Classes and tags of actors say what they are. Names of materials say what they look like: maps
hold no pictures of them, and where those are missing a floor of wood and a wall of concrete should
still not be one grey: cameras, and who drives by them, tell rooms apart by that.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from enum import Enum

from usarsim_maps.scene import Color, map_victim
from usarsim_maps.units import ROTATION_UNIT
from usarsim_server.simulation.frames import Pose, wire_from_pose
from usarsim_server.worlds.description import PathNode, StartPose, Victim

PACKAGE = "victimpackage."
"""Path nodes whose tags begin so are people in the modules of the world generator."""

LYING = ("lay", "lying", "dead", "sleep", "prone", "collapse")
SITTING = ("sit", "hugknees", "kneel", "crouch", "squat")
WAVING = ("wave", "waving", "push", "scratch")

_STUFF: tuple[tuple[str, tuple[float, float, float]], ...] = (
    ("wood plank parquet timber", (0.52, 0.38, 0.25)),
    ("brick", (0.58, 0.36, 0.28)),
    ("conc concrete cement", (0.56, 0.56, 0.54)),
    ("slate", (0.36, 0.39, 0.43)),
    ("marble", (0.80, 0.78, 0.74)),
    ("asphalt tarmac", (0.28, 0.28, 0.29)),
    ("tile tiles", (0.70, 0.66, 0.58)),
    ("gold", (0.68, 0.56, 0.30)),
    ("rust rusty", (0.46, 0.30, 0.21)),
    ("metal steel wire wires chainlink", (0.48, 0.51, 0.55)),
    ("grass turf lawn", (0.28, 0.45, 0.22)),
    ("carpet fabric cloth cubicle", (0.42, 0.46, 0.53)),
    ("sand", (0.74, 0.66, 0.48)),
    ("dirt mud soil", (0.42, 0.33, 0.24)),
    ("rock stone gravel rubble", (0.50, 0.48, 0.45)),
    ("water", (0.25, 0.38, 0.45)),
    ("plaster stucco", (0.76, 0.73, 0.67)),
    ("white", (0.88, 0.88, 0.86)),
    ("black", (0.10, 0.10, 0.10)),
    ("red", (0.66, 0.18, 0.15)),
    ("green", (0.22, 0.50, 0.25)),
    ("blue", (0.18, 0.32, 0.62)),
    ("yellow", (0.82, 0.70, 0.20)),
    ("ceiling roof", (0.80, 0.80, 0.78)),
    ("wall walls", (0.74, 0.70, 0.61)),
    ("floor ground", (0.47, 0.44, 0.40)),
)
"""Words and colours (red, green, blue as on screens); what things are made of comes before where
they are, so that a wall of brick is brick."""

_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+")

LONG = 4
"""Letters from which on a word may be the beginning or end of one in the name (`concwall`)."""


class ActorKind(Enum):
    """Groups of actor classes."""

    BRUSH = "brush"
    VOLUME = "volume"
    MESH = "mesh"
    MOVABLE = "movable mesh"
    START = "start"
    PATH_NODE = "path node"
    VICTIM = "victim"
    LIGHT = "light"
    SMOKE = "smoke"
    FOG = "fog"
    LEVEL = "level"
    OTHER = "other"


_CLASSES = {
    ActorKind.VOLUME: ".*volume",
    ActorKind.BRUSH: "brush",
    ActorKind.MOVABLE: "kactor.*|fracturedkactor",
    ActorKind.MESH: "staticmeshactor.*|staticmeshcollectionactor|interpactor|mover",
    ActorKind.START: ".*playerstart",
    ActorKind.PATH_NODE: ".*pathnode",
    ActorKind.VICTIM: ".*victim",
    ActorKind.LIGHT: ".*light|.*lighttoggleable",
    ActorKind.SMOKE: ".*smoke.*",
    ActorKind.FOG: ".*heightfog",
    ActorKind.LEVEL: "worldinfo|levelinfo|zoneinfo|skyzoneinfo",
}
"""Their names in lower case; the first that fits counts."""


def kind_of(actor_class: str) -> ActorKind:
    """The group of an actor class, by its name alone (package prefixes do not count)."""
    name = actor_class.rpartition(".")[2].lower()
    fitting = (kind for kind, names in _CLASSES.items() if re.fullmatch(names, name, re.DOTALL))
    return next(fitting, ActorKind.OTHER)


def announced(name: str, tag: str, actor_class: str) -> str:
    """What clients are told: the Tag, unless it is the class default, then the Name."""
    plain = actor_class.rpartition(".")[2].lower()
    if not tag or tag.lower() in (plain, "none", "playerstart", "pathnode"):
        return name
    return tag


def start_of(name: str, tag: str, actor_class: str, pose: Pose, yaw: float = 0.0) -> StartPose:
    """A start pose by the naming rule (worlds 25); yaw in rotation units is told unwrapped
    (worlds 8)."""
    _, (_, _, wrapped) = wire_from_pose(pose)
    turns = round((yaw * ROTATION_UNIT - wrapped) / math.tau)
    return StartPose(announced(name, tag, actor_class), pose, max(-1000, min(1000, turns)))


def path_node_of(name: str, tag: str, actor_class: str, pose: Pose) -> PathNode:
    """A path node by the same rule (worlds 26)."""
    return PathNode(announced(name, tag, actor_class), pose.position)


def is_victim_tag(tag: str) -> bool:
    """Whether a path node is a person (worlds 26)."""
    return tag.lower().startswith(PACKAGE)


def victim_of_tag(tag: str, pose: Pose, known: Counter[str]) -> Victim:
    """A person from a tag such as `VictimPackage.animation.GenericMale_AnimTree_hugKnees`.

    Clients know people as `MaleVictim_0`, `FemaleVictim_0`, ...; `known` counts them.
    """
    words = tag.lower()
    female = "female" in words
    animation = words.rpartition("_")[2]
    posture = "standing"
    if any(word in animation for word in LYING):
        posture = "lying"
    elif any(word in animation for word in SITTING):
        posture = "sitting"
    properties: dict[str, object] = {"animation": tag.rpartition("_")[2]}
    if any(word in animation for word in WAVING):
        properties["motion"] = "wave"
    word = "FemaleVictim" if female else "MaleVictim"
    known[word] += 1
    return map_victim(
        name=f"{word}_{known[word] - 1}",
        pose=pose,
        figure="female" if female else "male",
        posture=posture,
        status="Dead" if "dead" in animation else "Alive",
        properties=properties,
    )


def likely_color(name: str) -> Color | None:
    """The colour that a material `Package.Group.Name` probably has, by the last part of its name.

    None if it says nothing.
    """
    words = [word.lower() for word in _WORD.findall(name.rpartition(".")[2])]
    for stuff, color in _STUFF:
        if any(_fits(word, key) for key in stuff.split() for word in words):
            return (*color, 1.0)
    return None


def _fits(word: str, key: str) -> bool:
    return word == key or (len(key) >= LONG and (word.startswith(key) or word.endswith(key)))
