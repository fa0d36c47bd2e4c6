"""What the saved state of a Gazebo world says: places, sizes, what was added and removed since.

Poses of a state are in the world's frame, those of links and nested models, too, unless they name
another frame. SDFormat 1.12 calls the elements `model_state`, `link_state` and `light_state`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from usarsim_maps.gazebo.elements import LIGHT_STATE, LINK_STATE, MODEL_STATE, STATE, Elements
from usarsim_maps.gazebo.frames import Scope, frame_of, sound_matrix
from usarsim_maps.meshes.xml_text import Document, Node
from usarsim_maps.scene import Array

Saved = TypeVar("Saved")


def _within(prefix: str, known: Mapping[str, Saved]) -> dict[str, Saved]:
    """What is known under names that begin with a prefix, by the rest of the names."""
    return {
        word.removeprefix(prefix): value for word, value in known.items() if word.startswith(prefix)
    }


@dataclass(slots=True, eq=False)
class SavedModel:
    """A model in a state; all matrices (4, 4) are in the world's frame."""

    matrix: Array | None = None  # None: as the model itself says
    scale: Array = field(default_factory=lambda: np.ones(3))  # of its shapes
    links: dict[str, Array] = field(default_factory=dict)  # by name, `inner::link` if nested
    models: dict[str, SavedModel] = field(default_factory=dict)  # nested ones by name

    def inner(self, name: str) -> SavedModel | None:
        """What is said about a model in this one: under its own name, or in names of links and
        models that step into it."""
        prefix = f"{name}::"
        links, models = _within(prefix, self.links), _within(prefix, self.models)
        own = self.models.get(name)
        if own is None:
            return SavedModel(links=links, models=models) if links or models else None
        return SavedModel(own.matrix, own.scale, links | own.links, models | own.models)

    def names(self, prefix: str = "") -> Iterator[tuple[str, str]]:
        """Kinds and full names of all that something is said about."""
        for link in self.links:
            yield "link", prefix + link
        for name, model in self.models.items():
            yield "model", prefix + name
            yield from model.names(f"{prefix}{name}::")


@dataclass(slots=True, eq=False)
class SavedWorld:
    """A state of a world."""

    models: dict[str, SavedModel] = field(default_factory=dict)  # by name
    lights: dict[str, Array] = field(default_factory=dict)  # matrices by name
    deleted: set[str] = field(default_factory=set)  # names of what was removed

    def names(self) -> Iterator[tuple[str, str]]:
        """Kinds and full names of all whose place or size the state says."""
        yield from SavedModel(models=self.models).names()
        for light in self.lights:
            yield "light", light


class SavedStates:
    """The first state of a world: it counts, later ones are left out."""

    def __init__(self, document: Document, world: Node, unit: float, elements: Elements) -> None:
        """Take a `world` element, the metres per unit of the file, and who counts what is left."""
        self._document = document
        self._unit = unit
        self._elements = elements
        states = list(world.all("state"))
        self._state = states[0] if states else None
        for later in states[1:]:
            elements.leave("state", later.get("world_name"))

    def insertions(self) -> Iterator[Node]:
        """Elements that were added to the world."""
        for node in () if self._state is None else self._state.all("insertions"):
            yield from node.children

    def world(self, scope: Scope) -> SavedWorld:
        """What the state says; names of frames are those of the world."""
        saved = SavedWorld()
        if self._state is None:
            return saved
        self._elements.count(self._state, STATE)
        for node in self._state.children:
            match node.tag:
                case "model" | "model_state":
                    self._model(node, scope, saved.models)
                case "light" | "light_state":
                    self._elements.count(node, LIGHT_STATE)
                    self._keep(node, scope, saved.lights)
                case "deletions":
                    saved.deleted |= {name.text for name in node.all("name")}
        return saved

    def _model(self, node: Node, scope: Scope, into: dict[str, SavedModel]) -> None:
        self._elements.count(node, MODEL_STATE)
        model = SavedModel(self._matrix(node, scope))
        scale = self._document.vector(node.child("scale"), 3)
        if scale is not None:
            if (np.abs(scale) > 0.0).all():
                model.scale = scale
            else:
                self._document.note(node, "a scale of zero was left out")
        for child in node.children:
            match child.tag:
                case "link" | "link_state":
                    self._elements.count(child, LINK_STATE)
                    self._keep(child, scope, model.links)
                case "model" | "model_state":
                    self._model(child, scope, model.models)
        if node.get("name"):
            into.setdefault(node.get("name"), model)

    def _keep(self, node: Node, scope: Scope, into: dict[str, Array]) -> None:
        matrix = self._matrix(node, scope)
        if matrix is not None and node.get("name"):
            into.setdefault(node.get("name"), matrix)

    def _matrix(self, node: Node, scope: Scope) -> Array | None:
        pose = node.child("pose")
        matrix = sound_matrix(self._document, pose, self._unit)
        frame = frame_of(pose)
        return matrix if matrix is None or not frame else scope.matrix(frame) @ matrix
