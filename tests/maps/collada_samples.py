"""Small COLLADA files, for the tests of several readers."""

from __future__ import annotations

import numpy as np
from mesh_samples import FACES, WEDGE

SQUARE = "0 0 0 1 0 0 1 1 0 0 1 0"


def source(name: str, numbers: str, stride: int = 3) -> str:
    """An array with its accessor."""
    count = len(numbers.split())
    return (
        f'<source id="{name}"><float_array id="{name}-a" count="{count}">{numbers}</float_array>'
        f'<technique_common><accessor source="#{name}-a" count="{count // stride}" '
        f'stride="{stride}"/></technique_common></source>'
    )


def geometry(primitives: str, points: str = SQUARE, more: str = "", name: str = "g") -> str:
    """A geometry whose vertices are called `v`."""
    return (
        f'<geometry id="{name}"><mesh>{source(name + "-p", points)}{more}'
        f'<vertices id="{name}-v"><input semantic="POSITION" source="#{name}-p"/></vertices>'
        f"{primitives}</mesh></geometry>"
    )


def document(
    geometries: str,
    nodes: str = '<node name="n"><instance_geometry url="#g"/></node>',
    asset: str = "<up_axis>Z_UP</up_axis>",
    more: str = "",
) -> str:
    """A whole file."""
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n'
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">\n'
        f"<asset>{asset}</asset>\n{more}\n<library_geometries>{geometries}</library_geometries>\n"
        f'<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene>'
        "</library_visual_scenes>\n"
        '<scene><instance_visual_scene url="#s"/></scene>\n</COLLADA>\n'
    )


VERTEX = '<input semantic="VERTEX" source="#g-v" offset="0"/>'
TRIANGLES = f'<triangles count="4">{VERTEX}<p>{" ".join(map(str, FACES.ravel()))}</p></triangles>'


def wedge(points: np.ndarray[tuple[int, ...], np.dtype[np.float64]] = WEDGE) -> str:
    """The wedge as a geometry."""
    return geometry(TRIANGLES, " ".join(f"{value:g}" for value in points.ravel()))
