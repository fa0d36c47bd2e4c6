"""Joins compiled models: many fixed geoms, compiled once, into every model of a world.

MuJoCo compiles a model of 150,000 fixed pieces in 8 to 15 s, and would do all of it again for every
robot that comes. What never moves has no part in the dynamics: it is geoms of the world body and
their meshes, nothing else. So it is compiled once (`FixedPart`), and what moves is compiled without
it. `FixedPart.into` puts the rows of both into one model, which takes as long as copying them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array, Numbers
from usarsim_server.simulation.raw import RawModel, Rows, fields, rows_of

_NAMED = (
    *("body", "jnt", "geom", "site", "cam", "light", "flex", "mesh", "skin", "hfield", "tex"),
    *("mat", "pair", "exclude", "eq", "tendon", "actuator", "sensor", "numeric", "text", "tuple"),
    *("key", "plugin"),
)
"""Kinds of elements, in the order of their parts of MuJoCo's table of names."""
_ROOM = 2
"""Places that this table has for each element."""
_SEED, _FACTOR = 5381, 33
"""Of the sum of a name, which says where in the table it is looked for first."""
_NONE = np.uint64(2**64 - 1)
"""Stands for the sum of no name."""
_BEGINS = {
    "geom_dataid": "nmesh",
    "name_geomadr": "nnames",
    "name_meshadr": "nnames",
    "mesh_vertadr": "nmeshvert",
    "mesh_normaladr": "nmeshnormal",
    "mesh_texcoordadr": "nmeshtexcoord",
    "mesh_faceadr": "nmeshface",
    "mesh_graphadr": "nmeshgraph",
    "mesh_octadr": "noct",
    "mesh_polyadr": "nmeshpoly",
    "mesh_polyvertadr": "nmeshpolyvert",
    "mesh_polymapadr": "nmeshpolymap",
}
"""Columns with numbers of rows elsewhere, -1 for none, and the size that those count in."""
_BULK = tuple(sorted({"ngeom", *_BEGINS.values()}))
"""Sizes that are those of both parts together, but for the boxes."""
_LARGEST = ("npolygonmax", "nmeshdegmax")
"""Sizes that are the largest of any mesh."""
ARENA = 192
"""Bytes of working memory for each fixed geom: MuJoCo gives models 150 to 175."""
_OTHERS = (
    *("njnt", "nsite", "ncam", "nlight", "nflex", "nskin", "nhfield", "ntex", "nmat", "npair"),
    *("nexclude", "neq", "ntendon", "nactuator", "nsensor", "nplugin", "nuser_geom"),
)
"""Sizes of what a fixed part does not have."""
_BOXES = ("bvh_depth", "bvh_child", "bvh_nodeid", "bvh_aabb")


@dataclass(frozen=True, slots=True)
class _Tree:
    """A tree of boxes, root first: depths (n,), children (n, 2) or -1, what is in a leaf (n,) or
    -1, middles and half sizes (n, 6), m. In the order of `_BOXES`."""

    depths: NDArray[np.int32]
    children: NDArray[np.int32]
    leaves: NDArray[np.int32]
    boxes: Array

    def below(self, nodes: int) -> _Tree:
        """The same one level deeper, behind so many other nodes."""
        return _Tree(
            self.depths + np.int32(1),
            np.where(self.children < 0, -1, self.children + nodes).astype(np.int32),
            self.leaves,
            self.boxes,
        )

    def columns(self) -> tuple[Rows, ...]:
        return self.depths, self.children, self.leaves, self.boxes


class FixedPart:
    """Geoms of the world body that never move, and their meshes, compiled.

    Used by one thread at a time.

    Attributes:
        count: how many geoms.
        size: bytes that they take in a model.
        names: of the geoms that have one.
    """

    def __init__(self, models: Sequence[mujoco.MjModel]) -> None:
        """Put models together that hold nothing else; at least one.

        Raises:
            ValueError: there is something else in one of them.
        """
        files = [RawModel.of(model) for model in models]
        self._sizes = dict.fromkeys(_BULK, 0)
        self._largest = {name: max(file.sizes[name] for file in files) for name in _LARGEST}
        gathered: dict[str, list[Rows]] = {name: [] for name in _bulk_columns()}
        trees, inner = [], []
        boxes = 0  # of meshes, so far
        for file in files:
            _check_fixed(file)
            rows = {name: pieces[0] for name, pieces in file.rows.items()}
            own = int(rows["body_bvhnum"][0])
            leaf = rows["bvh_nodeid"][:own] >= 0
            numbers = rows["bvh_nodeid"][:own][leaf] + self._sizes["ngeom"]
            trees.append((rows["bvh_aabb"][:own][leaf], numbers))
            inner.append([rows[name][own:] for name in _BOXES])
            gathered["mesh_bvhadr"].append(_later(rows["mesh_bvhadr"], boxes - own))
            boxes += file.sizes["nbvh"] - own
            for name, begin in _BEGINS.items():
                rows[name] = _later(rows[name], self._sizes[begin])
            for name in gathered.keys() - {"mesh_bvhadr"}:
                gathered[name].append(rows[name])
            for name in _BULK:
                self._sizes[name] += file.sizes[name]
        self._rows = {name: np.concatenate(parts) for name, parts in gathered.items()}
        self._inner = [np.concatenate(parts) for parts in zip(*inner, strict=True)]
        self._tree = _divided(*(np.concatenate(parts) for parts in zip(*trees, strict=True)))
        self._masks = {
            f"body_{kind}": int(np.bitwise_or.reduce(self._rows[f"geom_{kind}"]))
            for kind in ("contype", "conaffinity")
        }
        self.count = self._sizes["ngeom"]
        self.size = sum(one.nbytes for one in (*self._rows.values(), *self._inner))
        self._sums = {
            kind: _sums_of_names(self._rows["names"], self._rows[f"name_{kind}adr"])
            for kind in ("geom", "mesh")
        }
        self.names = frozenset(_names(self._rows["names"], self._rows["name_geomadr"]))

    def into(self, model: mujoco.MjModel) -> mujoco.MjModel:
        """A model with the geoms of another one and these, which come behind those of its world.

        Raises:
            ValueError: MuJoCo does not take it.
        """
        file = RawModel.of(model)
        rows, own = file.rows, int(model.body_geomnum[0])
        _count_geoms_on(file, own, self.count, self._masks)
        self._insert_boxes(file, own)
        known = {
            kind: _sums_of_names(file.whole("names"), file.whole(f"name_{kind}adr"))
            for kind in _NAMED
        }
        for kind, sums in self._sums.items():
            begin = own if kind == "geom" else len(known[kind])
            known[kind] = np.concatenate((known[kind][:begin], sums, known[kind][begin:]))
        where = {}
        for name, counted in _bulk_columns().items():
            added, old = self._rows[name], file.whole(name)
            if name == "mesh_bvhadr":
                added = _later(added, file.sizes["nbvh"] - len(self._inner[0]))
            elif name in _BEGINS:
                added = _later(added, file.sizes[_BEGINS[name]])
            # The geoms of the world come first, those of bodies behind them.
            begin = own if counted == "ngeom" else len(old)
            where[name] = slice(begin, begin + len(added))
            rows[name] = [old[:begin], added, old[begin:]]
        for name, number in self._sizes.items():
            file.sizes[name] += number
        for name, number in self._largest.items():
            file.sizes[name] = max(file.sizes[name], number)
        file.sizes["narena"] += ARENA * self.count
        rows["names_map"] = [_places_of_names(known[kind]) for kind in _NAMED]
        file.sizes["nnames_map"] = sum(map(len, rows["names_map"]))
        joined = file.model()
        # What is the same in both is kept once.
        for name, part in where.items():
            if name not in _BEGINS and name != "mesh_bvhadr":
                self._rows[name] = rows_of(joined, name)[part]
        begin = joined.nbvh - len(self._inner[0])
        self._inner = [rows_of(joined, name)[begin:] for name in _BOXES]
        return joined

    def _insert_boxes(self, file: RawModel, own: int) -> None:
        """Put the trees of these geoms and of their meshes into a file with so many geoms of the
        world: under a new root stand the tree of those, and that of these."""
        rows = file.rows
        boxes = [file.whole(name) for name in _BOXES]
        nodes, counts = file.whole("body_bvhadr"), file.whole("body_bvhnum").copy()
        old = int(counts[0])
        fixed, above = self._tree, []
        if old:
            before = _Tree(*(one[:old] for one in boxes)).below(1)
            fixed = fixed.below(1 + old)
            both = _around(np.array([before.boxes[0], fixed.boxes[0]]))
            halves = np.array([[1, 1 + old]], np.int32)
            root = _Tree(np.zeros(1, np.int32), halves, np.full(1, -1, np.int32), both[None])
            above = [root.columns(), before.columns()]
        fixed = replace(fixed, leaves=_later(fixed.leaves, own))
        bodies = int((nodes + counts).max(initial=old)) - old  # meshes come behind them
        rest = [one[old:] for one in boxes]
        numbers = rest[_BOXES.index("bvh_nodeid")].copy()
        geoms = numbers[:bodies]
        geoms[geoms >= own] += self.count
        rest[_BOXES.index("bvh_nodeid")] = numbers
        for name, *pieces in zip(_BOXES, *above, fixed.columns(), rest, self._inner, strict=True):
            rows[name] = pieces
        grown = len(fixed.leaves) + (1 if old else 0)
        meshes = file.whole("mesh_bvhadr")
        rows["mesh_bvhadr"] = [np.where(meshes >= old, meshes + grown, meshes)]
        counts[0] = old + grown
        nodes = np.where(nodes >= old, nodes + grown, nodes)
        nodes[0] = 0
        rows["body_bvhadr"], rows["body_bvhnum"] = [nodes], [counts]
        file.sizes["nbvh"] = file.sizes["nbvhstatic"] = sum(map(len, rows["bvh_nodeid"]))


@cache
def _bulk_columns() -> dict[str, str]:
    """Arrays that have rows for fixed geoms and for their meshes, and what counts these rows."""
    return {name: counted for name, counted in fields()[1].items() if counted in _BULK} | {
        "mesh_bvhadr": "nmesh"
    }


def _later(numbers: Rows, by: int) -> Rows:
    """Numbers of rows of which so many come before now; -1 stays."""
    return np.where(numbers < 0, numbers, numbers + by).astype(numbers.dtype)


def _check_fixed(file: RawModel) -> None:
    """Refuse everything but geoms of the world that have an end, and their meshes.

    Raises:
        ValueError: there is something else.
    """
    if file.sizes["nbody"] != 1 or not file.sizes["ngeom"] or any(file.sizes[n] for n in _OTHERS):
        raise ValueError("there is something else than fixed geoms and meshes")
    if (file.whole("geom_type") == int(mujoco.mjtGeom.mjGEOM_PLANE)).any():
        raise ValueError("there is an endless plane")


def _count_geoms_on(file: RawModel, own: int, more: int, masks: Mapping[str, int]) -> None:
    """Change the numbers of geoms behind those of the world, of which there will be more."""
    first, counts = file.whole("body_geomadr"), file.whole("body_geomnum").copy()
    first = np.where(first >= own, first + more, first)
    first[0] = 0
    counts[0] += more
    file.rows["body_geomadr"], file.rows["body_geomnum"] = [first], [counts]
    for name, mask in masks.items():
        bodies = file.whole(name).copy()
        bodies[0] |= mask
        file.rows[name] = [bodies]
    geom = int(mujoco.mjtObj.mjOBJ_GEOM)
    round_ones = (int(mujoco.mjtWrap.mjWRAP_SPHERE), int(mujoco.mjtWrap.mjWRAP_CYLINDER))
    for name, of_geoms in (
        ("pair_geom1", True),
        ("pair_geom2", True),
        ("sensor_objid", file.whole("sensor_objtype") == geom),
        ("sensor_refid", file.whole("sensor_reftype") == geom),
        ("tuple_objid", file.whole("tuple_objtype") == geom),
        ("wrap_objid", np.isin(file.whole("wrap_type"), round_ones)),
    ):
        numbers = file.whole(name)
        file.rows[name] = [np.where(of_geoms & (numbers >= own), numbers + more, numbers)]


def _names(text: Rows, places: Rows) -> list[str]:
    """The names at some places of a text, but for empty ones."""
    content = text.tobytes()
    found = (content[place : content.index(b"\0", place)] for place in places.tolist())
    return [name.decode() for name in found if name]


def _sums_of_names(text: Rows, begins: Rows) -> NDArray[np.uint64]:
    """What MuJoCo makes of the names (n,) that begin at some places of a text; for none `_NONE`."""
    sums = np.full(len(begins), _SEED, np.uint64)
    if not len(begins):
        return sums
    text = np.append(text, np.zeros(1, np.uint8))
    at = begins.astype(np.int64)
    going = np.arange(len(begins))
    nameless = text[at] == 0
    while len(going):
        letters = text[at[going]]
        going = going[letters != 0]
        signed = text[at[going]].astype(np.int8).astype(np.int64).astype(np.uint64)
        sums[going] = (sums[going] * np.uint64(_FACTOR)) ^ signed
        at[going] += 1
    sums[nameless] = _NONE
    return sums


def _places_of_names(sums: NDArray[np.uint64]) -> NDArray[np.int32]:
    """The part of one kind in MuJoCo's table by which elements are found by their names: numbers
    of elements, where their names are looked for, else -1."""
    room = _ROOM * len(sums)
    table = np.full(room, -1, np.int32)
    named = np.flatnonzero(sums != _NONE)
    if not len(named):
        return table
    sums = sums[named]
    # Who finds a place taken takes the next free one. Who comes to the end begins in front.
    wanted = (sums % np.uint64(room)).astype(np.int64)
    while True:
        order = np.argsort(wanted, kind="stable")
        row = np.arange(len(order))
        places = np.maximum.accumulate(wanted[order] - row) + row
        if places[-1] < room:
            break
        wanted[order[places >= room]] = 0
    table[places] = named[order]
    return table


def _divided(boxes: Array, leaves: Numbers) -> _Tree:
    """A tree of boxes (n, 6), halved by their middles along the longest side, level by level."""
    count = len(boxes)
    order = np.arange(count)
    begins, ends, nodes = np.array([0]), np.array([count]), np.array([0])
    children = np.full((2 * count - 1, 2), -1, np.int32)
    found = np.full(2 * count - 1, -1, np.int32)
    depths = np.zeros(2 * count - 1, np.int32)
    around = np.zeros((2 * count - 1, 6))
    low, high = boxes[:, :3] - boxes[:, 3:], boxes[:, :3] + boxes[:, 3:]
    used, depth = 1, 0
    while len(nodes):
        # The parts follow on one another, with gaps where leaves are done.
        rows = np.concatenate([np.arange(b, e) for b, e in zip(begins, ends, strict=True)])
        sizes = ends - begins
        starts = np.cumsum(sizes) - sizes
        least = np.minimum.reduceat(low[order[rows]], starts)
        most = np.maximum.reduceat(high[order[rows]], starts)
        around[nodes] = np.hstack([(least + most) / 2.0, (most - least) / 2.0])
        depths[nodes] = depth
        done = sizes == 1
        single = order[begins[done]]
        found[nodes[done]], around[nodes[done]] = leaves[single], boxes[single]
        axes = np.repeat((most - least).argmax(axis=1), sizes)
        owner = np.repeat(np.arange(len(nodes)), sizes)
        keys = boxes[order[rows], axes]
        order[rows] = order[rows][np.lexsort((keys, owner))]
        begins, ends, nodes = begins[~done], ends[~done], nodes[~done]
        middles = (begins + ends) // 2
        pairs = used + np.arange(2 * len(nodes)).reshape(-1, 2)
        children[nodes] = pairs
        used += 2 * len(nodes)
        begins = np.stack([begins, middles], axis=1).ravel()
        ends = np.stack([middles, ends], axis=1).ravel()
        nodes, depth = pairs.ravel(), depth + 1
    return _Tree(depths, children, found, around)


def _around(boxes: Array) -> Array:
    """The box (6,) around boxes (n, 6)."""
    low, high = (boxes[:, :3] - boxes[:, 3:]).min(axis=0), (boxes[:, :3] + boxes[:, 3:]).max(axis=0)
    return np.concatenate(((low + high) / 2.0, (high - low) / 2.0))
