"""How large maps are: backdrops, wide ground, cuts, and sizes that are believed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from built_worlds import build_world, cuboid_mesh, grid_mesh, import_text, scene_of, thing
from t3d_maps import brush, level, start

from usarsim_maps.build.extent import measure, without_sky
from usarsim_maps.findings import Findings
from usarsim_maps.scene import (
    Box,
    Collision,
    Cylinder,
    Heightfield,
    Part,
    Plane,
    Scene,
    SceneObject,
    Sphere,
)
from usarsim_server.base.errors import MapImportError
from usarsim_server.simulation.frames import Pose
from usarsim_server.worlds.description import StartPose

HUT = thing(cuboid_mesh((-2, -2, 0), (2, 2, 4)), "Hut")
HILLS = thing(
    grid_mesh(40, 40, 505.0, 9.0 * np.sin(np.linspace(0, 9, 41))[:, None] * np.ones(41)), "Hills"
)
DOME = SceneObject("Dome", (Part(Sphere(900.0)),))
BOX = SceneObject("Around", (Part(Box((3000.0, 3000.0, 600.0))),))
OUT = StartPose("Out", Pose((150.0, -150.0, 10.0)))


def size(scene: Scene) -> list[float]:
    """Extents of what counts, m."""
    corners = measure(scene).corners
    assert corners is not None
    return [round(value, 3) for value in (corners[1] - corners[0]).tolist()]


class TestBackdrops:
    """What goes around and over the rest does not count, ground does."""

    @pytest.mark.parametrize("backdrop", [DOME, BOX], ids=lambda thing: thing.name)
    @pytest.mark.parametrize("starts", [[], [StartPose("In", Pose((5.0, 0.0, 0.3)))]])
    def test_a_backdrop(self, backdrop: SceneObject, starts: list[StartPose]) -> None:
        """Around a hut, or a hut on a plane, it is none of the map."""
        for more in ((), (SceneObject("Plane", (Part(Plane()),)),)):
            scene = scene_of(backdrop, HUT, *more, starts=starts)
            assert size(scene) == [4.0, 4.0, 4.0]
            assert measure(scene).backdrops == (backdrop.name,)

    def test_around_wide_ground(self) -> None:
        """A sky around a landscape is a backdrop, the landscape is not."""
        scene = scene_of(DOME, HILLS, HUT, starts=[OUT])
        assert measure(scene).backdrops == ("Dome",)
        assert size(scene)[:2] == [505.0, 505.0]

    def test_hills_above_a_hut(self) -> None:
        """Ground whose tops are higher than all else covers nothing."""
        valley = thing(HUT.parts[0].shape, "Low", Pose((0.0, 0.0, -8.0)))  # type: ignore[arg-type]
        scene = scene_of(HILLS, valley)
        assert size(scene)[:2] == [505.0, 505.0]
        assert not measure(scene).backdrops

    @pytest.mark.parametrize(
        "ground",
        [
            SceneObject("Slab", (Part(Box((600.0, 600.0, 2.0))),), Pose((0.0, 0.0, -1.0))),
            SceneObject("Disc", (Part(Cylinder(300.0, 2.0)),), Pose((0.0, 0.0, -1.0))),
            thing(grid_mesh(2, 2, 600.0), "Mesh"),
        ],
        ids=lambda thing: thing.name,
    )
    def test_wide_ground(self, tmp_path: Path, ground: SceneObject) -> None:
        """Of any kind it counts, and a start far out on it is kept."""
        far = StartPose("Far", Pose((250.0, 100.0, 0.3)))
        world = build_world(tmp_path, scene_of(ground, HUT, starts=[far]))
        assert [place.name for place in world.built.checks] == ["Far"]
        assert (world.built.upper - world.built.lower)[0] == pytest.approx(600.0, abs=0.1)
        assert not world.texts()
        assert world.description.upper[0] > 300.0

    def test_height_fields(self, tmp_path: Path) -> None:
        """Terrain of 620 m counts, with mountains above a house in its valley."""
        heights = np.abs(np.linspace(-60.0, 60.0, 63))[:, None] * np.ones(63)
        field = Heightfield("Terrain", heights, (10.0, 10.0), Pose((-310.0, -310.0, 0.0)))
        far = StartPose("Far", Pose((250.0, 0.0, 1.0)))
        world = build_world(tmp_path, scene_of(HUT, heightfields=(field,), starts=[far]))
        assert [place.name for place in world.built.checks] == ["Far"]
        assert (world.built.upper - world.built.lower)[1] == pytest.approx(620.0, abs=0.1)

    def test_what_a_start_stands_on(self) -> None:
        """A hall of 500 m with a crate in it is the map, if its floor is what robots stand on."""
        hall = thing(cuboid_mesh((-250, -250, 0), (250, 250, 30), inward=True), "Hall")
        crate = thing(cuboid_mesh((0, 0, 0), (1, 1, 1)), "Crate")
        stands = StartPose("S", Pose((20.0, 0.0, 0.3)))
        assert size(scene_of(hall, crate, starts=[stands])) == [500.0, 500.0, 30.0]
        deck = thing(cuboid_mesh((-30, -30, -1), (30, 30, 0.1)), "Deck")
        assert size(scene_of(hall, crate, deck, starts=[stands]))[0] == 60.0

    def test_backdrops_are_told(self, tmp_path: Path) -> None:
        """By name, whatever they are made of."""
        floor = thing(cuboid_mesh((-9, -9, -0.2), (9, 9, 0)), "Floor")
        world = build_world(tmp_path, scene_of(DOME, floor, HUT))
        assert "Dome: a backdrop around the map" in world.texts()
        painted = SceneObject("Dome", (Part(Sphere(900.0), collision=Collision.NONE),))
        world = build_world(tmp_path, scene_of(painted, floor, HUT))
        assert "Dome: a backdrop around the map" in world.texts()
        assert "felt" not in world.texts()

    def test_ground_that_is_too_large(self, tmp_path: Path) -> None:
        """Where the scale is assumed, ground of 9 km does not count; a start on it does."""
        sea = thing(grid_mesh(1, 1, 9000.0), "Sea")
        far = StartPose("Far", Pose((250.0, 100.0, 0.3)))
        world = build_world(tmp_path, scene_of(sea, HUT, starts=[far]))
        assert "Sea: it is 9,000 m large" in world.texts()
        assert [place.name for place in world.built.checks] == ["Far"]
        assert world.built.upper[0] == pytest.approx(250.0)
        scene = scene_of(sea, HUT)
        stated = replace(scene, source=replace(scene.source, stated=True))
        assert size(stated) == [9000.0, 9000.0, 4.0]


class TestSkies:
    """Skies by their names."""

    def test_a_sky_is_left_out(self) -> None:
        """Around the map, or where there is nothing else."""
        findings = Findings()
        sky = replace(DOME, name="SM_SkySphere_2")
        assert without_sky(scene_of(sky, HUT, starts=[OUT]), findings).objects == (HUT,)
        assert without_sky(scene_of(sky), findings).objects == ()
        assert findings.warnings()[0].text == "a painted sky was left out"

    def test_what_is_only_called_so_stays(self) -> None:
        """A bar that is called Skybox is beside the hut, and a floor below it carries a start."""
        bar = thing(cuboid_mesh((10, 10, 0), (14, 14, 5)), "Skybox_Bar")
        assert len(without_sky(scene_of(bar, HUT), Findings()).objects) == 2
        whole = thing(cuboid_mesh((-600, -600, 0), (600, 600, 300), inward=True), "Skybox")
        scene = scene_of(whole, thing(cuboid_mesh((1, 1, 0), (2, 2, 1))), starts=[
            StartPose("S", Pose((5.0, 5.0, 0.3)))
        ])  # fmt: skip
        assert len(without_sky(scene, Findings()).objects) == 2


class TestBrushes:
    """Levels of brushes."""

    SLAB = brush("Slab", (-500, -500, 0), (500, 500, 250))
    SHAFT = brush("Shaft", (-100, -100, -2500), (100, 100, 2500), "CSG_Subtract")

    def test_cuts_of_additions(self, tmp_path: Path) -> None:
        """What only cuts does not count, in bounds and cameras neither."""
        world = import_text(tmp_path, level(self.SLAB, self.SHAFT))
        assert world.built.extents is not None
        np.testing.assert_allclose(world.built.extents, [[-2, -2, 0], [2, 2, 1]])
        assert world.description.upper[2] == pytest.approx(101.0)
        assert world.model.stat.extent == pytest.approx(4.0)

    def test_cuts_of_rock(self, tmp_path: Path) -> None:
        """In a level cut out of rock the cuts are the extent, whether rock was there or added."""
        hall = brush("Hall", (-1000, -1000, 0), (1000, 1000, 800), "CSG_Subtract")
        rock = brush("Rock", (-250_000, -250_000, -5_000), (250_000, 250_000, 60_000))
        for text in (level(hall, self.SLAB), level(rock, hall, self.SLAB)):
            world = import_text(tmp_path, text)
            assert world.built.extents is not None
            np.testing.assert_allclose(world.built.extents, [[-4, -4, 0], [4, 4, 3.2]])
        assert "Rock: a backdrop around the map: it was cut off 50 m around it" in world.texts()

    def test_ground_of_brushes(self, tmp_path: Path) -> None:
        """A slab of 600 m under a hut is ground; nothing is cut off."""
        ground = brush("Ground", (-75_000, -75_000, -500), (75_000, 75_000, 0))
        hut = brush("Hut", (-500, -500, 0), (500, 500, 1000))
        far = start("Far", (50_000, 50_000, 75), "Far")
        world = import_text(tmp_path, level(ground, hut, far))
        assert [place.name for place in world.built.checks] == ["Far"]
        assert (world.built.upper - world.built.lower)[0] == pytest.approx(600.0)
        assert "backdrop" not in world.texts()


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("side", [0.02, 5000.0, 50_000.0])
def test_sizes(tmp_path: Path, side: float, stated: bool) -> None:
    """Only assumed scales are absurd, as long as single precision can tell where things are."""
    scene = scene_of(
        thing(cuboid_mesh((0, 0, -side), (side, side, 0))),
        starts=[StartPose("S", Pose((side / 2.0, side / 2.0, 0.2)))],
    )
    scene = replace(scene, source=replace(scene.source, stated=stated))
    if stated and side < 10_000.0:
        world = build_world(tmp_path, scene)
        assert ("are much" in world.texts()) == (side > 2000.0)
    else:
        with pytest.raises(MapImportError, match="absurd"):
            build_world(tmp_path, scene)
