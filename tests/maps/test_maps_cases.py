"""Maps of the kinds that others make come out right: one folder of `cases/` for each.

Every `*.toml` of a case's `expect/` folder names a map of the case and what is true of the imported
world. Frame: x forward, y left, z up; metres.

```
map = "kiosk.world"
options = { scale = 250.0 }      # of `ImportOptions`; `assets` are folders of the case
refused = "regular expression"   # the import ends with this error; then nothing else counts
extents = [4.0, 4.0, 1.0]        # that the report tells
start = [[1.0, 0.0, 0.3]]        # places of all starts of the world
objects = ["laden"]              # names of all named objects, in order
report = ["regular expression"]  # found in the report
silent = ["regular expression"]  # not found in the report

[[thing]]                        # corners of a named object, in the world
name = "crate"
lower = [1.9, 2.3, 0.2]
upper = [2.1, 2.7, 0.8]
felt = false                     # of what is felt, not of what is seen
movable = true
mass = 13.0                      # kg

[[ray]]                          # what a ray meets first
from = [0.0, 0.0, 0.5]
along = [1.0, 0.0, 0.0]
felt = false                     # what is felt, not what is seen
distance = 2.0                   # inf: nothing
color = [1.0, 0.0, 0.0]          # of what it meets: material, or vertex colour; no picture
opacity = 0.2
thing = "crate"                  # the named object that it meets
```

`tolerance` (m; default 0.01) may stand in the file, in a thing and in a ray.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from usarsim_maps.convert import Request, import_map
from usarsim_maps.reader import ImportOptions
from usarsim_server.base.errors import MapImportError
from usarsim_server.simulation.rays.triangles import triangles
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene

Array = NDArray[np.float64]

CASES = Path(__file__).parent / "cases"
EXPECTATIONS = sorted(CASES.glob("*/expect/*.toml"))
TOP_KEYS = {
    "map", "options", "refused", "extents", "start", "objects", "report", "silent", "tolerance",
    "thing", "ray",
}  # fmt: skip
THING_KEYS = {"name", "lower", "upper", "felt", "movable", "mass", "tolerance"}
RAY_KEYS = {"from", "along", "felt", "distance", "color", "opacity", "thing", "tolerance"}

PART = re.compile(r"^s\d+:|\.(?:part|solid)(?:-\d+)?$")
"""What the builder adds to the name of an object for the names of its geoms."""


class ImportedWorld:
    """The compiled world of an import, without robots."""

    def __init__(self, folder: Path) -> None:
        self.description = load_world(folder)
        self.model: mujoco.MjModel = build_scene(self.description).compile()
        self._data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self._data)

    def is_felt(self, geom: int) -> bool:
        """Whether robots collide with a geom."""
        return bool(self.model.geom_contype[geom] | self.model.geom_conaffinity[geom])

    def is_seen(self, geom: int) -> bool:
        """Whether cameras draw a geom."""
        return bool(self.model.geom_group[geom] < 3)

    def thing_of(self, geom: int) -> str:
        """The named object that a geom belongs to."""
        body = self.model.geom_bodyid[geom]
        name = self.model.body(body).name if body else self.model.geom(geom).name
        return PART.sub("", name)

    def geoms(self, name: str, *, felt: bool) -> list[int]:
        """Geoms of a named object that are felt, or that are seen."""
        wanted = self.is_felt if felt else self.is_seen
        return [
            geom for geom in range(self.model.ngeom) if wanted(geom) and self.thing_of(geom) == name
        ]

    def corners(self, geoms: list[int]) -> tuple[Array, Array]:
        """Lower and upper corner of some geoms, m."""
        place = self._data
        points = np.concatenate(
            [
                triangles(
                    self.model, geom, place.geom_xpos[geom], place.geom_xmat[geom].reshape(3, 3)
                ).reshape(-1, 3)
                for geom in geoms
            ]
        )
        return points.min(axis=0), points.max(axis=0)

    def mass(self, name: str) -> float:
        """kg of a movable object."""
        return float(self.model.body(name).mass[0])

    def cast(self, origin: Array, along: Array, *, felt: bool) -> tuple[float, int]:
        """Distance, m, to what a ray meets first, and the geom: infinity and -1 for nothing."""
        model = self.model.__copy__()
        wanted = self.is_felt if felt else self.is_seen
        for geom in range(model.ngeom):
            # MuJoCo's rays pass what has no opacity.
            model.geom_group[geom] = 0 if wanted(geom) else 5
            if felt:
                model.geom_matid[geom] = -1
                model.geom_rgba[geom, 3] = 1.0
        groups = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
        met = np.zeros(1, dtype=np.int32)
        way = mujoco.mj_ray(
            model, self._data, origin, along / np.linalg.norm(along), groups, 1, -1, met, None
        )
        return (float(way), int(met[0])) if met[0] >= 0 else (math.inf, -1)

    def rgba(self, geom: int) -> Array:
        """Colour of a geom, its picture aside."""
        material = self.model.geom_matid[geom]
        color = self.model.geom_rgba[geom] if material < 0 else self.model.mat_rgba[material]
        return np.array(color, dtype=float)


@pytest.mark.parametrize(
    "path", EXPECTATIONS, ids=[f"{path.parent.parent.name}/{path.stem}" for path in EXPECTATIONS]
)
def test_the_map_comes_out_right(path: Path, tmp_path: Path) -> None:
    """A map of a case becomes the world that its table says."""
    expected = tomllib.loads(path.read_text(encoding="utf-8"))
    assert expected.keys() <= TOP_KEYS, expected.keys() - TOP_KEYS
    case = path.parent.parent
    if Path(expected["map"]).suffix.startswith(".usd"):
        pytest.importorskip("pxr", reason="usd-core is not installed: pip install usd-core")
    options = dict(expected.get("options", {}))
    assets = tuple(case / folder for folder in options.pop("assets", ()))
    request = Request(
        case / expected["map"], out=tmp_path, options=ImportOptions(assets=assets, **options)
    )
    if "refused" in expected:
        with pytest.raises(MapImportError, match=expected["refused"]):
            import_map(request)
        return
    result = import_map(request)
    text = result.report.text()
    print(text)  # shown if the test fails
    world = ImportedWorld(result.folder)
    tolerance = float(expected.get("tolerance", 0.01))
    if "extents" in expected:
        assert result.report.extents == pytest.approx(expected["extents"], abs=tolerance)
    if "start" in expected:
        places = [list(start.pose.position) for start in world.description.starts]
        assert np.shape(places) == np.shape(expected["start"]), places
        assert np.allclose(places, expected["start"], atol=tolerance), places
    if "objects" in expected:
        assert [thing.original for thing in world.description.objects] == expected["objects"]
    for pattern in expected.get("report", ()):
        assert re.search(pattern, text), f"the report lacks {pattern!r}"
    for pattern in expected.get("silent", ()):
        assert not re.search(pattern, text), f"the report has {pattern!r}"
    for thing in expected.get("thing", ()):
        check_thing(world, thing, tolerance)
    for ray in expected.get("ray", ()):
        check_ray(world, ray, tolerance)


def check_thing(world: ImportedWorld, thing: Mapping[str, Any], tolerance: float) -> None:
    """A named object has the corners, the mass and the mobility that a table says."""
    assert thing.keys() <= THING_KEYS, thing.keys() - THING_KEYS
    tolerance = float(thing.get("tolerance", tolerance))
    name = thing["name"]
    geoms = world.geoms(name, felt=thing.get("felt", False))
    assert geoms, f"there is no {name}"
    low, high = world.corners(geoms)
    assert np.allclose(low, thing.get("lower", low), atol=tolerance), (name, low, high)
    assert np.allclose(high, thing.get("upper", high), atol=tolerance), (name, low, high)
    if "movable" in thing:
        moves = world.model.body_dofnum[world.model.geom_bodyid[geoms[0]]] > 0
        assert bool(moves) is thing["movable"], name
    if "mass" in thing:
        assert world.mass(name) == pytest.approx(thing["mass"], rel=1e-3), name


def check_ray(world: ImportedWorld, ray: Mapping[str, Any], tolerance: float) -> None:
    """A ray meets what a table says."""
    assert ray.keys() <= RAY_KEYS, ray.keys() - RAY_KEYS
    origin, along = np.array(ray["from"], dtype=float), np.array(ray["along"], dtype=float)
    distance, geom = world.cast(origin, along, felt=ray.get("felt", False))
    if "distance" in ray:
        within = float(ray.get("tolerance", tolerance))
        assert distance == pytest.approx(ray["distance"], abs=within), dict(ray)
    if "thing" in ray:
        assert geom >= 0 and world.thing_of(geom) == ray["thing"], dict(ray)  # noqa: PT018
    if "color" in ray:
        assert np.allclose(world.rgba(geom)[:3], ray["color"], atol=0.02), world.rgba(geom)
    if "opacity" in ray:
        assert world.rgba(geom)[3] == pytest.approx(ray["opacity"], abs=0.01), dict(ray)
