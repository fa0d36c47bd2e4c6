"""The models of a Gazebo world: includes, nesting, joints (worlds reference 8; items 48, 49)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from usarsim_maps.findings import Findings
from usarsim_maps.gazebo.elements import (
    INCLUDE,
    JOINT,
    MODEL,
    POPULATION,
    ROOT,
    WORLD,
    Elements,
)
from usarsim_maps.gazebo.files import BUILTIN, GazeboFiles, builtin_name, model_name
from usarsim_maps.gazebo.frames import WORLD as WORLD_LINK
from usarsim_maps.gazebo.frames import Entry, Item, Scope, flag
from usarsim_maps.gazebo.places import Person, person_words
from usarsim_maps.gazebo.populations import population
from usarsim_maps.gazebo.states import SavedModel, SavedStates, SavedWorld
from usarsim_maps.gazebo.urdf import model_of
from usarsim_maps.meshes.xml_text import Document, Node, read_xml
from usarsim_maps.scene import Array
from usarsim_maps.support import SupportTable
from usarsim_maps.units import affine
from usarsim_server.base.errors import MapImportError

MAX_MODELS = 20_000
MAX_DEPTH = 30

_OWN = {"allow_auto_disable", "enable_wind", "pose", "self_collide", "static"}
"""Children of a model that a merged include leaves behind: they are about the model as a whole."""

_ENDS = ("parent", "child")

_DESCRIBED = ("model", "light", "actor")
"""Elements that a file holds in the place of a model, in the order in which they are looked for."""


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A link: its matrix (4, 4) in the world, its element, the names around it."""

    name: str  # its path below the top model
    matrix: Array
    item: Item
    scope: Scope
    scale: Array  # (3,) of its shapes, from a saved state

    @property
    def node(self) -> Node:
        """The element."""
        return self.item.node

    @property
    def document(self) -> Document:
        """The file of the element."""
        return self.item.document


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """Links that stay together: a static model, or a rigid part of a moving one."""

    name: str  # of the model, with the models around it (`outer::inner`)
    matrix: Array  # (4, 4) in the world
    links: tuple[Link, ...]  # what it is made of
    static: bool  # it does not move
    person: Person | None = None  # it is somebody


@dataclass(slots=True)
class _Assembly:
    """Links and joints of a moving model with all that is nested in it, or of several models."""

    root: str  # the name of the model; empty if there are several
    links: list[Link] = field(default_factory=list)
    joints: list[tuple[str, str, str]] = field(default_factory=list)  # parent, child, type
    models: dict[str, Array] = field(default_factory=dict)  # matrix of the model of each link
    still: set[str] = field(default_factory=set)  # names of links of static models

    def path(self, model: str) -> str:
        """What stands before the name of a link of a model."""
        inner = model.removeprefix(self.root).removeprefix("::")
        return f"{inner}::" if inner else ""


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """What a model is told by what is around it."""

    matrix: Array  # (4, 4) of the owner in the world
    prefix: str = ""  # name of the owner
    static: bool = False
    assembly: _Assembly | None = None  # None: each model is its own
    saved: SavedModel | None = None  # what the saved state says about the owner
    scale: Array = field(default_factory=lambda: np.ones(3))  # of the owner, from the state


class Models:
    """Expands a world."""

    def __init__(self, files: GazeboFiles, unit: float) -> None:
        self.names: list[str] = []  # of all models that were used
        # of the world and of models, with file and matrix
        self.lights: list[tuple[Document, Node, Array]] = []
        self.builtin: list[tuple[str, Array]] = []  # names and matrices of Gazebo's own models
        # names and matrices of models that were not found
        self.missing: list[tuple[str, Array]] = []
        self.saved = SavedWorld()  # the saved state of the world
        self._files = files
        self._findings: Findings = files.context.findings
        self._elements = Elements(self._findings)
        self._unit = unit
        self._documents: dict[Path, Document | None] = {}
        self._scopes: dict[int, tuple[Entry, Scope]] = {}
        self._bodies: list[Body] = []
        self._alone: Node | None = None
        self._count = 0
        self._met: set[str] = set()  # full names of models, links and lights
        self._unknown: list[str] = []  # beginnings of names within models that are not there

    def world(self, document: Document, owner: Node) -> list[Body]:
        """All bodies below a `world` element, or below the root of a model file.

        In a file without a world there is no ground, and models stand still.

        Poses in the first saved state win. Includes that go in a circle, or are too many, are a
        `MapImportError`.
        """
        if owner is document.root and len(list(owner.all("model"))) == 1:
            self._alone = owner.child("model")
        states = SavedStates(document, owner, self._unit, self._elements)
        table = ROOT if owner is document.root else WORLD
        items = list(self._items(document, owner, owner.children, "", (document.path,), table))
        names = {item.name for item in items if item.name}
        added = [
            node
            for node in states.insertions()
            if node.tag in ("model", "light", "joint", "include") and node.get("name") not in names
        ]
        items += self._items(document, owner, added, "", (document.path,), table)
        scope = Scope(document, owner, self._unit, items, self.scope)
        self.saved = states.world(scope)
        joined = _Assembly("")
        together = self._joints(scope, joined, "")
        for item in scope.items:
            name = _name(item)
            if name in self.saved.deleted:
                self._met.add(name)
                self._unknown.append(f"{name}::")
                continue
            place = _Place(
                np.eye(4),
                static=owner is document.root,
                assembly=joined if name in together else None,
                saved=SavedModel(models=self.saved.models),
            )
            self._item(item, scope, place)
        if joined.links:
            self._moving(joined)
        return self._bodies

    def count_unmet(self) -> None:
        """Count what the saved state places and the world does not have.

        Lights have to have been asked for, by `light`.
        """
        for kind, name in self.saved.names():
            if name not in self._met and not name.startswith(tuple(self._unknown)):
                self._elements.leave(f"state {kind}", name)

    def light(self, name: str, matrix: Array) -> Array | None:
        """Where a light is by the saved state, else by its matrix; None if it was deleted."""
        self._met.add(name)
        if name in self.saved.deleted:
            return None
        return self.saved.lights.get(name, matrix)

    # ---- includes --------------------------------------------------------------------------

    def scope(self, entry: Entry) -> Scope:
        """The names in a model."""
        known = self._scopes.get(id(entry))
        if known is None:
            document, node = entry.document, entry.node
            items = self._items(document, node, node.children, "", entry.above, MODEL)
            known = entry, Scope(document, node, self._unit, items, self.scope)
            self._scopes[id(entry)] = known
        return known[1]

    def _items(
        self,
        document: Document,
        owner: Node,
        nodes: Iterable[Node],
        home: str,
        above: tuple[Path, ...],
        table: SupportTable,
    ) -> Iterator[Item]:
        """Items of a model or world; what its table leaves out is counted."""
        for node in nodes:
            if node.tag in ("model", "include"):
                self._counted(document, node, above)
            match node.tag:
                case "model":
                    name = node.get("name")
                    entry = Entry(document, node, name or "model", above=above)
                    yield Item(node, document, home, name, entry)
                case "include":
                    yield from self._included(document, owner, node, home, above, table)
                case "population" if table is WORLD:
                    copies = list(self._population(document, node))
                    yield from self._items(document, owner, copies, home, above, table)
                case "frame" | "joint" | "light" | "link":
                    yield Item(node, document, home, node.get("name"))
                case _:
                    self._left_out(node, table)

    def _left_out(self, node: Node, table: SupportTable) -> None:
        if node.tag == "gravity" and table is WORLD:
            return  # told where it differs from the server's
        if node.tag == "plugin" and any(is_start(inner) for inner in node.children):
            return
        if node.tag == "state" or is_start(node):
            return
        self._elements.count_child(node, table)

    def _population(self, document: Document, node: Node) -> Iterator[Node]:
        self._elements.count(node, POPULATION, node.get("name"))
        copies = list(population(document, node, MAX_MODELS))
        if not copies:
            self._elements.leave("population", node.get("name"))
        return iter(copies)

    def _counted(self, document: Document, node: Node, above: tuple[Path, ...]) -> None:
        self._count += 1
        if self._count > MAX_MODELS or len(above) > MAX_DEPTH:
            problem = f"more than {MAX_MODELS} models, or nested deeper than {MAX_DEPTH}"
            raise document.error(node, problem, "split the world")

    def _included(
        self,
        document: Document,
        owner: Node,
        node: Node,
        home: str,
        above: tuple[Path, ...],
        table: SupportTable,
    ) -> Iterator[Item]:
        """What an include stands for: one item, or, merged, all that is in the model or world."""
        self._elements.count(node, INCLUDE, node.word("name"))
        entry = self._entry(document, node, above)
        given = node.word("name")
        if entry is None:
            yield Item(node, document, home, given or model_name(node.word("uri")))
            return
        merged = flag(node.get("merge"), False) and entry.node.tag == "model"
        if merged and table is not MODEL and entry.node.child("link") is not None:
            document.note(node, "a model with links cannot be merged into a world; it stays one")
            merged = False
        if entry.node.tag != "world" and not merged:
            yield Item(node, document, home, entry.name, entry)
            return
        proxy = f"__merged_{self._count}__"
        yield Item(node, document, home, proxy, entry, merged=True)
        inner = [child for child in entry.node.children if child.tag not in _OWN]
        yield from self._items(entry.document, owner, inner, proxy, entry.above, table)

    def _entry(self, document: Document, node: Node, above: tuple[Path, ...]) -> Entry | None:
        """What is in the file that an include means; None if there is none, or nothing in it."""
        uri = node.word("uri")
        path = self._files.model(uri, document.path)
        if path is None:
            return None
        name = model_name(uri)
        if path in above or path == document.path:
            problem = f"{path.name} of model {name!r} includes itself"
            raise document.error(node, problem, "break the circle of includes")
        inner = self._load(path)
        if inner is None:
            self._elements.leave("include", node.word("name") or name)
            return Entry(document, Node("nothing", {}, node.line), name)
        world = inner.root.child("world")
        found = [inner.root.child(tag) for tag in _DESCRIBED]
        if world is not None and len(list(world.all("model"))) == 1 and not flag(
            node.get("merge"), False
        ):  # fmt: skip
            found.append(world.child("model"))
        found.append(world)
        chosen = next((node for node in found if node is not None), None)
        if chosen is None:
            self._findings.warn(path.name, "there is no model in this file")
            self._elements.leave("include", node.word("name") or name)
            return Entry(document, Node("nothing", {}, node.line), name)
        static = flag(node.word("static"), False) if node.child("static") is not None else None
        label = node.word("name") or chosen.get("name") or name
        return Entry(inner, chosen, label, static, name, (*above, path))

    def _load(self, path: Path) -> Document | None:
        if path not in self._documents:
            try:
                document = read_xml(path, findings=self._findings)
                if document.root.tag == "robot":
                    document = model_of(document, self._findings)
                self._documents[path] = document
            except MapImportError as error:
                self._findings.warn(path.name, str(error))
                self._documents[path] = None
        return self._documents[path]

    # ---- models ----------------------------------------------------------------------------

    def _item(self, item: Item, scope: Scope, place: _Place) -> None:
        """A model, an include or a light, in a world or in another model."""
        node, entry = item.node, item.entry
        if node.tag == "light":
            matrix = place.matrix @ _scaled(scope.place(item), place.scale)
            self._light(item.document, node, matrix, _joined(place.prefix, node.get("name")))
        if node.tag not in ("model", "include"):
            return
        if entry is None:
            saved = None if place.saved is None else place.saved.inner(item.name)
            told = None if saved is None else saved.matrix
            name = _joined(place.prefix, item.name)
            self._met.add(name)
            self._unknown.append(f"{name}::")
            self._absent(node, place.matrix @ scope.place(item) if told is None else told)
        elif entry.node.tag == "light":
            self._light(entry.document, entry.node, place.matrix @ scope.place(item), entry.name)
        elif entry.node.tag == "actor":
            self._elements.leave("actor", entry.name)
        elif entry.node.tag == "model" and not item.merged:
            self._model(item, entry, scope, place)

    def _light(self, document: Document, node: Node, matrix: Array, name: str) -> None:
        found = self.light(name, matrix)
        if found is not None:
            self.lights.append((document, node, found))

    def _absent(self, node: Node, matrix: Array) -> None:
        """An include whose model is not there: one of Gazebo's own, a person, or missing."""
        uri, given = node.word("uri"), node.word("name")
        name = model_name(uri)
        own = builtin_name(name)
        if own in BUILTIN:
            self.builtin.append((own, matrix))
        elif person_words(name)[0]:
            self._findings.missing("person", uri[:200])
            self._person(given or name, matrix, (), name, given)
        else:
            self._findings.missing("model", uri[:200])
            self.missing.append((given or name, matrix))

    def _model(self, item: Item, entry: Entry, around: Scope, place: _Place) -> None:
        """Links of a model and of the models in it."""
        node = entry.node
        name = _joined(place.prefix, entry.name)
        self._met.add(name)
        if name in self.saved.deleted:
            self._unknown.append(f"{name}::")
            return
        if item.node.tag == "include":
            self.names.append(entry.uri)
        saved = None if place.saved is None else place.saved.inner(entry.name)
        saved = saved or SavedModel()
        matrix = place.matrix @ _scaled(around.place(item), place.scale)
        matrix = matrix if saved.matrix is None else saved.matrix
        scale = place.scale * saved.scale
        scope = self.scope(entry)
        own = flag(node.word("static"), False) if entry.static is None else entry.static
        fixed = place.static or own
        if fixed and not own and not place.prefix:
            self._findings.warn(name, "a model without a world stands still: it has no ground")
        whole = place.assembly
        if whole is None or fixed:
            whole = _Assembly(name)
        links = []
        for link in scope.all("link"):
            self._met.add(_joined(name, link.name))
            standing = saved.links.get(link.name)
            if standing is None:
                standing = matrix @ _scaled(scope.place(link), scale)
            links.append(Link(whole.path(name) + link.name, standing, link, scope, scale))
        words = (entry.uri, node.get("name"), entry.name)
        if person_words(*words)[0] and node is not self._alone:
            # Who imports a figure alone wants to see just that.
            self._person(name, matrix, links, *words)
            return
        if fixed:
            self._bodies.append(Body(name, matrix, tuple(links), static=True))
            if place.assembly is not None:
                path = place.assembly.path(name)
                place.assembly.still |= {path + link.name for link in links}
        else:
            whole.links += links
            whole.models |= {link.name: matrix for link in links}
        self._joints(scope, whole, whole.path(name))
        inside = _Place(matrix, name, fixed, whole if not fixed else None, saved, scale)
        for inner in scope.items:
            self._item(inner, scope, inside)
        if not fixed and whole is not place.assembly:
            self._moving(whole)

    def _joints(self, scope: Scope, whole: _Assembly, path: str) -> set[str]:
        """Enter the joints of a model or world; the names of the models that they connect."""
        models = set()
        for item in scope.all("joint"):
            self._elements.count(item.node, JOINT, item.name)
            parent, child = (scope.link(item.node.word(tag), item.home) for tag in _ENDS)
            ends = [end if end == WORLD_LINK else path + end for end in (parent, child)]
            whole.joints.append((ends[0], ends[1], item.node.get("type")))
            models |= {end.partition("::")[0] for end in (parent, child) if "::" in end}
        return models

    def _person(self, name: str, matrix: Array, links: Iterable[Link], *words: str) -> None:
        more = [
            node.text
            for link in links
            for visual in link.node.all("visual")
            for node in [visual.child("geometry", "mesh", "uri")]
            if node is not None
        ]
        _, figure, posture = person_words(*words, *more)
        self._bodies.append(Body(name, matrix, tuple(links), True, Person(figure, posture)))

    def _moving(self, whole: _Assembly) -> None:
        """Bodies of a moving model: links that joints connect stay as they are to each other."""
        owner: dict[str, str] = {link.name: link.name for link in whole.links}

        def find(link: str) -> str:
            while owner[link] != link:
                link = owner[link]
            return link

        anchored: set[str] = set()
        stiff = 0
        for parent, child, kind in whole.joints:
            stiff += kind != "fixed"
            still = [end == WORLD_LINK or end in whole.still for end in (parent, child)]
            for end, other in ((child, still[0]), (parent, still[1])):
                if end in owner and other:
                    anchored.add(end)
            if child in owner and parent in owner:
                owner[find(child)] = find(parent)
        if stiff:
            subject = whole.root or "joints of the world"
            self._findings.warn(subject, "joints of models are stiff here; its parts do not turn")
        groups: dict[str, list[Link]] = {}
        for link in whole.links:
            groups.setdefault(find(link.name), []).append(link)
        fixed = {find(link) for link in anchored}
        tops = [whole.root or links[0].name.partition("::")[0] for links in groups.values()]
        parts = Counter(tops)
        for top, (root, links) in zip(tops, groups.items(), strict=True):
            static = root in fixed or any(
                flag(link.node.word("kinematic"), False) for link in links
            )
            label = _joined(whole.root, links[0].name) if parts[top] > 1 else top
            place = whole.models[links[0].name] if static else links[0].matrix
            self._bodies.append(Body(label, place, tuple(links), static))


def is_start(node: Node) -> bool:
    """Whether an element is a start pose of the leagues' plug-in, `StartPose_1` and so on."""
    return node.tag.lower().startswith("startpose")


def _name(item: Item) -> str:
    return item.name if item.entry is None else item.entry.name


def _joined(prefix: str, name: str) -> str:
    return f"{prefix}::{name}" if prefix else name


def _scaled(matrix: Array, scale: Array) -> Array:
    """A place in a model whose saved state scales it: ways grow, turns stay."""
    return affine(matrix[:3, :3], matrix[:3, 3] * scale)
