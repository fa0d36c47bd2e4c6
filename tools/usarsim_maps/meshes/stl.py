"""Reads STL, binary and text.

The format knows neither units nor axes: one unit is taken for a metre and z for up, and the
report says that this was assumed (worlds reference 2.4, item 42).
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from usarsim_maps.files import read_bytes
from usarsim_maps.findings import Findings
from usarsim_maps.meshes.mesh_files import axes_of, broken, with_hulls
from usarsim_maps.meshes.polygons import MAX_TRIANGLES, check_count, make_mesh
from usarsim_maps.numbers import read_number
from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import Array, Part, Scene, SceneObject

MAX_BYTES = 512 << 20
HEADER = 84

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("extra", "<u2")])


@register("stl")
class StlReader(Reader):
    """Triangles; every `solid` of a text file is an object."""

    title = "STL"
    extensions = (".stl",)
    head = re.compile(rb"(?is)\A\s*solid.*facet")

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`."""
        content = read_bytes(source, MAX_BYTES)
        axes = axes_of(context.options, "Z", stated=False)
        if _is_text(content):
            solids = _text(source, content)
        else:
            solids = [_binary(source, content, context.findings)]
        objects = []
        for name, corners in solids:
            if not len(corners):
                continue
            points, inverse = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
            mesh = make_mesh(name, points, inverse.reshape(-1, 3), linear=axes.linear)
            objects.append(SceneObject(name, (Part(mesh),), kind="mesh"))
        if not objects:
            raise broken(source, "there are no triangles in this file")
        context.findings.count("mesh", len(objects))
        return Scene(source=axes.source(source, "STL"), objects=with_hulls(objects))


def _is_text(content: bytes) -> bool:
    """Whether a file is text. Some binary ones begin with `solid`, too, or have more behind.

    The number of facets tells them apart: text has no bytes below that of a tabulator, and no
    binary file of a size that is read has so many facets that each of its four bytes is above.
    """
    if content.lstrip()[:5].lower() != b"solid":
        return False
    return len(content) < HEADER or min(content[80:HEADER]) >= ord("\t")


def _binary(source: Path, content: bytes, findings: Findings) -> tuple[str, Array]:
    if len(content) < HEADER:
        raise broken(source, f"{len(content)} bytes are no STL file")
    count = int.from_bytes(content[80:HEADER], "little")
    there = (len(content) - HEADER) // _FACET.itemsize
    if count > there:
        problem = f"{count} triangles are announced, {there} are there"
        raise broken(source, problem)
    check_count(source, count)
    facets = np.frombuffer(content, _FACET, count, HEADER)
    marked = int(np.count_nonzero(facets["extra"]))
    if marked:
        # Some programs keep colours there, each in a way of its own.
        findings.skip("attribute of a facet", times=marked)
    with np.errstate(invalid="ignore"):
        return source.stem, facets["corners"].astype(float)


def _text(source: Path, content: bytes) -> list[tuple[str, Array]]:
    solids: list[tuple[str, list[float]]] = []
    count = 0
    closed = True
    for number, line in enumerate(content.splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        match words[0].lower():
            case b"vertex":
                try:
                    values = [read_number(word.decode("latin-1")) for word in words[1:4]]
                except ValueError:
                    values = []
                if len(values) != 3 or not solids:
                    problem = f"{line[:60].decode('latin-1')!r} is no vertex"
                    raise broken(source, problem, number)
                solids[-1][1].extend(values)
                count += 1
            case b"solid":
                name = b" ".join(words[1:]).decode("utf-8", "replace")
                solids.append((name or source.stem, []))
                closed = False
            case b"endsolid":
                closed = True
            case b"endfacet" if count % 3:
                problem = "a facet without three vertices"
                raise broken(source, problem, number)
    if count % 3 or not closed:
        raise broken(source, "the file ends in the middle of a solid")
    if count > 3 * MAX_TRIANGLES:
        check_count(source, count // 3)
    return [(name, np.array(values).reshape(-1, 3, 3)) for name, values in solids]
