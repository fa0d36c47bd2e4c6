"""One layout in several formats is one world: no format mirrors, turns or scales (item 9)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from built_worlds import build_world
from mesh_samples import read, upright
from numpy.typing import NDArray
from t3d_maps import corner

from usarsim_maps.build.facts import Probe

Array = NDArray[np.float64]

BLOCKS = {
    "Floor": ((-4, -4, -0.2), (4, 4, 0)),
    "Long": ((0, -0.4, 0), (3, 0, 1)),
    "Short": ((0, -1.6, 0), (0.4, -0.4, 1)),
    "Tower": ((2, 0.4, 0), (2.4, 1, 2)),
}
"""What `corner` is in the simulation's frame: 250 Unreal units are a metre, y is turned round."""

QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def corners(name: str) -> Array:
    """Of a block."""
    low, high = (np.array(end, dtype=float) for end in BLOCKS[name])
    pick = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    return np.asarray(low + pick * (high - low))


def sdf() -> str:
    """Boxes."""
    models = ""
    for name, (low, high) in BLOCKS.items():
        middle = " ".join(f"{(a + b) / 2:g}" for a, b in zip(low, high, strict=True))
        size = " ".join(f"{b - a:g}" for a, b in zip(low, high, strict=True))
        box = f"<geometry><box><size>{size}</size></box></geometry>"
        models += (
            f'<model name="{name}"><static>1</static><pose>{middle} 0 0 0</pose><link name="l">'
            f'<visual name="v">{box}</visual><collision name="c">{box}</collision></link></model>'
        )
    return f'<sdf version="1.6"><world name="w">{models}</world></sdf>'


def obj() -> str:
    """Quads, y up."""
    lines, count = [], 0
    for name in BLOCKS:
        lines.append(f"o {name}")
        lines += [f"v {x:g} {y:g} {z:g}" for x, y, z in upright(corners(name))]
        lines += ["f " + " ".join(str(count + i + 1) for i in quad) for quad in QUADS]
        count += 8
    return "\n".join(lines)


def collada() -> str:
    """Quads, z up, in inches."""
    shapes = nodes = ""
    for name in BLOCKS:
        numbers = " ".join(f"{value / 0.0254:.9g}" for value in corners(name).ravel())
        chain = " ".join(str(i) for quad in QUADS for i in quad)
        shapes += (
            f'<geometry id="{name}"><mesh><source id="{name}-s"><float_array>{numbers}'
            f'</float_array></source><vertices id="{name}-v"><input semantic="POSITION" '
            f'source="#{name}-s"/></vertices><polylist><input semantic="VERTEX" '
            f'source="#{name}-v" offset="0"/><vcount>4 4 4 4 4 4</vcount><p>{chain}</p>'
            "</polylist></mesh></geometry>"
        )
        nodes += f'<node name="{name}"><instance_geometry url="#{name}"/></node>'
    return (
        '<COLLADA version="1.4.1"><asset><unit meter="0.0254"/><up_axis>Z_UP</up_axis></asset>'
        f"<library_geometries>{shapes}</library_geometries><library_visual_scenes>"
        f'<visual_scene id="s">{nodes}</visual_scene></library_visual_scenes></COLLADA>'
    )


def view(folder: Path, name: str, text: str) -> Array:
    """Heights of what is seen and of what is felt from above, on a grid."""
    path = folder / name
    path.write_text(text)
    world = build_world(folder, read(path))
    down = np.array([[0.0, 0.0, -1.0]])
    places = [
        (float(x), float(y), 5.0) for x in np.arange(-3.9, 4, 0.6) for y in np.arange(-3.9, 4, 0.6)
    ]
    seen = [world.rays(place, down)[0] for place in places]
    probe = Probe(world.built.folder / "scene.xml", path)
    felt = [probe.height(place) for place in places]
    return np.array([seen, felt])


@pytest.mark.parametrize(
    ("name", "text"), [("map.sdf", sdf()), ("map.obj", obj()), ("map.dae", collada())]
)
def test_the_same_view(tmp_path: Path, name: str, text: str) -> None:
    """From above every format looks like the T3D version of the layout, and feels like it."""
    expected = view(tmp_path, "map.t3d", corner())
    found = view(tmp_path, name, text)
    assert set(np.round(expected[0], 3)) == {5.0, 4.0, 3.0}
    assert np.allclose(found, expected, atol=1e-4)
