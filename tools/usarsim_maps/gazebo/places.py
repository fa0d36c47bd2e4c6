"""Start poses and people of Gazebo worlds: elements, comments, text files beside the world.

People are models with a mesh; here they become victims. Values are in Gazebo's frame, which is the
simulation's (worlds reference 3, item 50).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from usarsim_maps.files import read_text
from usarsim_maps.findings import Findings
from usarsim_maps.geometry import points_of
from usarsim_maps.meshes.xml_text import Document
from usarsim_maps.numbers import read_number
from usarsim_maps.scene import Array, Part, map_victim
from usarsim_maps.units import pose_of_matrix
from usarsim_server.base.errors import MapImportError
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.worlds.description import StartPose, Victim

MAX_BYTES = 1 << 20
MAX_STARTS = 1_000

_COMMENTED = re.compile(r"<StartPose[\w.-]*\s*>([^<]{1,200})</StartPose", re.I)
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_LINE = re.compile(rf"^\s*([A-Za-z_]\w{{0,60}})\s*:\s*((?:{_NUMBER}[\s,]*){{3,6}})(.*)$")

PERSON = {"victim", "victims", "person", "survivor", "randy", "human", "casualty", "pedestrian"}
FEMALE = {"female", "woman", "girl", "lady"}
POSTURES = {
    "sitting": {"sitting", "sit"},
    "lying": {"lying", "laying", "fallen"},
    "standing": {"standing", "walking"},
}


@dataclass(frozen=True, slots=True)
class Person:
    """A model is somebody: figure, and posture if a name says it."""

    figure: str
    posture: str | None


def person_words(*names: str) -> tuple[bool, str, str | None]:
    """Whether names mean a person; the figure; and the posture, if they say one."""
    words: set[str] = set()
    for name in names:
        spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
        words |= set(re.split(r"[^a-z]+", spaced.lower()))
    postures = [posture for posture, group in POSTURES.items() if words & group]
    figure = "female" if words & FEMALE else "male"
    return bool(words & PERSON), figure, postures[-1] if postures else None


def starts_of(document: Document, unit: float = 1.0) -> list[StartPose]:
    """Start poses of a world: its `StartPose_n` elements in their order."""
    nodes = (n for n in document.root.walk() if n.tag.lower().startswith("startpose"))
    return _starts([(node.tag, node.text) for node in nodes], document.findings, unit)


def commented_starts(document: Document, unit: float = 1.0) -> list[StartPose]:
    """Start poses that stand in a comment of a world: a plug-in that was switched off."""
    texts = [
        ("comment", found[1])
        for _, comment in document.comments
        for found in _COMMENTED.finditer(comment)
    ]
    starts = _starts(texts, document.findings, unit)
    if starts:
        document.findings.warn(
            document.path.name, "start poses were taken from a comment of the world"
        )
    return starts


def _starts(texts: list[tuple[str, str]], findings: Findings, unit: float) -> list[StartPose]:
    starts = []
    for tag, text in texts[:MAX_STARTS]:
        start = _start(text, unit)
        if start is None:
            findings.warn(tag, f"{text[:80]!r} is no start pose; write NAME x,y,z r,p,y")
        else:
            starts.append(start)
    return starts


def _start(text: str, unit: float) -> StartPose | None:
    """`NAME x,y,z roll,pitch,yaw`; the angles may be left out."""
    words = text.replace(",", " ").split()
    if not words:
        return None
    values = _floats(words[1:])
    if len(values) != len(words) - 1 or not (len(values) == 3 or len(values) >= 6):
        return None
    return StartPose(words[0], _pose(values, unit))


def _floats(words: Iterable[str]) -> list[float]:
    values = []
    for word in words:
        try:
            value = read_number(word)
        except ValueError:
            return []
        if not abs(value) < 1e6:
            return []
        values.append(value)
    return values


def _pose(values: Sequence[float], unit: float) -> Pose:
    x, y, z = (value * unit for value in values[:3])
    roll, pitch, yaw = values[3:6] if len(values) >= 6 else (0.0, 0.0, 0.0)
    return Pose((x, y, z), quaternion_from_rpy(roll, pitch, yaw))


# ---- text files ------------------------------------------------------------------------------


@dataclass(slots=True)
class Placement:
    """A section of a placement file."""

    path: Path  # of the file
    title: str  # of the section
    # its lines that are no places, such as the name of the map
    words: list[str] = field(default_factory=list)
    starts: list[StartPose] = field(default_factory=list)  # start poses
    victims: list[Victim] = field(default_factory=list)  # people


def find_placement(
    source: Path, victims: Sequence[Victim], models: Iterable[str], findings: Findings
) -> Placement | None:
    """The section of a text file beside the world that is about this world.

    Leagues gave out one file for all worlds of a year. A section belongs to a world if its title is
    the end of the world's name, or, where no title fits, if its victims are where the world's are.
    Of several that fit the one counts whose map is named like a model of the world.
    """
    best: tuple[int, Placement] | None = None
    for path in sorted(source.parent.glob("*.txt"))[:50]:
        if "placement" not in path.name.lower():
            continue
        try:
            sections = read_placement(path)
        except MapImportError as error:
            findings.warn(path.name, str(error))
            continue
        for section in sections:
            score = _score(section, source, victims, list(models))
            if score > 0 and (best is None or score > best[0]):
                best = (score, section)
    if best is None:
        return None
    findings.warn(best[1].path.name, f"its section {best[1].title!r} is taken to be this world's")
    return best[1]


def read_placement(path: Path) -> list[Placement]:
    """Sections of a placement file: `# title`, `Victim1 : x y z r p y`, `StartPoint1 : ...`."""
    sections = [Placement(path, path.stem)]
    for line in read_text(path, MAX_BYTES).split("\n"):
        if line.lstrip().startswith("#"):
            sections.append(Placement(path, line.strip("# \t")))
            continue
        found = _LINE.match(line)
        section = sections[-1]
        if found is None:
            section.words.append(line.strip("* \t"))
            continue
        name, values = found[1], _floats(found[2].replace(",", " ").split())
        if len(values) < 3:
            continue
        if name.lower().startswith("victim") and len(section.victims) < MAX_STARTS:
            section.victims.append(map_victim(name, _pose(values, 1.0)))
        elif name.lower().startswith("start") and len(section.starts) < MAX_STARTS:
            section.starts.append(StartPose(name, _pose(values, 1.0)))
    return [section for section in sections if section.starts or section.victims]


def _score(
    section: Placement, source: Path, victims: Sequence[Victim], models: Sequence[str]
) -> int:
    stem, title = _plain(source.stem), _plain(section.title)
    score = 0
    if title and stem.endswith(title):
        score += 100
    near = 0
    for victim in victims:
        x, y, _ = victim.pose.position
        near += any(
            abs(x - other.pose.position[0]) < 1.0 and abs(y - other.pose.position[1]) < 1.0
            for other in section.victims
        )
    if near and near == len(victims):
        score += 50 + near
    if score:
        named = {_plain(re.split(r"[_.]", word)[-2]) for word in section.words if ".world" in word}
        score += any(_plain(model).endswith(name) for model in models for name in named if name)
    return score


def _plain(text: str) -> str:
    return re.sub(r"[^a-z0-9]", "", text.lower())


UPRIGHT = 1.2
"""Height by greatest width of somebody who stands."""

ABOVE = 0.2
"""m above the lowest point of a figure, whence the floor below is looked for."""


def victim_of(name: str, person: Person, matrix: Array, parts: Sequence[Part]) -> Victim:
    """A victim where a model is; its matrix (4, 4) and those of its parts lead into the world.

    There are no parts if the model is missing.
    """
    yaw = _front(matrix)
    points = [found for found in map(points_of, parts) if len(found)]
    if not points:
        x, y, z = matrix[:3, 3].tolist()
        pose = Pose((x, y, z + ABOVE), quaternion_from_rpy(0.0, 0.0, yaw))
        return map_victim(name, pose, person.figure, person.posture or "")
    cloud = np.concatenate(points)
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    size = high - low
    standing = size[2] > UPRIGHT * max(size[0], size[1])
    if not standing:
        yaw = _feet(cloud, matrix)
    x, y, _ = ((low + high) / 2.0).tolist()
    pose = Pose((x, y, float(low[2]) + ABOVE), quaternion_from_rpy(0.0, 0.0, yaw))
    posture = person.posture or ("standing" if standing else "lying")
    return map_victim(name, pose, person.figure, posture)


def _front(matrix: Array) -> float:
    """Heading of a face: along x of the model, or along z where its y is up, as modellers do."""
    turn = pose_of_matrix(matrix).matrix()
    front = turn[:, 2] if int(np.argmax(np.abs(turn[2]))) == 1 else turn[:, 0]
    return float(np.arctan2(front[1], front[0]))


def _feet(cloud: Array, matrix: Array) -> float:
    """Heading of the feet of somebody who lies: away from where the model's own up axis leads."""
    flat = cloud[:, :2] - cloud[:, :2].mean(axis=0)
    _, _, axes = np.linalg.svd(flat[:: max(1, len(flat) // 500)], full_matrices=False)
    along = axes[0]
    head = matrix[:2, :3][:, int(np.argmax(np.abs(along @ matrix[:2, :3])))]
    if along @ head > 0.0:
        along = -along
    return float(np.arctan2(along[1], along[0]))
