"""Pictures of imported worlds show cuts through what is solid, and all of the map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from built_worlds import AXES, build_world, import_text
from numpy.typing import NDArray
from PIL import Image
from sdf_samples import PLUGIN, load, model, shape
from t3d_maps import brush, level, room, start, two_rooms

from usarsim_maps.build.preview import SKY, Preview, covered, write_previews
from usarsim_server.cameras.cutaway import CUT_COLOR
from usarsim_server.worlds.description import WorldDescription

Pixels = NDArray[np.uint8]


def preview_of(folder: Path, *actors: str) -> Preview:
    """Pictures of a map."""
    return Preview(import_text(folder, level(*actors)).description)


def like(image: Pixels, color: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which pixels have a colour."""
    return np.asarray((np.abs(image / 255.0 - color) < 0.01).all(axis=-1))


def test_the_plan_shows_walls_as_cuts(tmp_path: Path) -> None:
    """In a plan solid rock and walls are dark, floors and what is lower than the cut are not."""
    pillar = brush("Pillar", (100, 100, 0), (350, 350, 750))
    table = brush("Table", (-400, -400, 0), (-100, -100, 200))
    preview = preview_of(tmp_path, room(), pillar, table, start("S", (-300, 300, 60)))
    cut = like(preview.top(), CUT_COLOR)
    x, y, _ = preview._grid(800, 600)
    assert cut[(x > 0.45) & (x < 1.35) & (y > -1.35) & (y < -0.45)].all()  # the pillar
    assert cut[(np.abs(x) > 2.05) & (np.abs(x) < 2.2) & (np.abs(y) < 2.0)].all()  # the walls
    inside = (np.abs(x) < 1.95) & (np.abs(y) < 1.95)
    pillared = (x > 0.35) & (x < 1.45) & (y > -1.45) & (y < -0.35)
    assert not cut[inside & ~pillared].any()


@pytest.mark.parametrize("corner", range(4))
def test_views_show_all_of_the_map(tmp_path: Path, corner: int) -> None:
    """A room, its walls cut, stands clear of the edges of every view and fills a good part."""
    preview = preview_of(tmp_path, room(), start("S", (0, 0, 60)))
    image = preview.view(corner)
    sky = like(image, SKY)
    assert sky[0].all()
    assert sky[-1].all()
    assert sky[:, 0].all()
    assert sky[:, -1].all()
    assert 0.15 < (~sky).mean() < 0.9
    assert 0.01 < like(image, CUT_COLOR).mean() < 0.3


def test_a_cave_is_seen_into(tmp_path: Path) -> None:
    """In views of a room in a rock of 2 km the rock is cut, not hollow."""
    rock = brush("Rock", (-250_000, -250_000, -9_000), (250_000, 250_000, 9_000))
    cave = brush("Cave", (-1000, -1000, 0), (1000, 1000, 800), "CSG_Subtract")
    preview = preview_of(tmp_path, rock, cave, start("S", (0, 0, 60)))
    image = preview.view(0)
    assert like(image, CUT_COLOR)[[0, 0, -1, -1], [0, -1, 0, -1]].all()
    assert not like(image, CUT_COLOR)[300, 400]


def test_starts_point_ahead(tmp_path: Path) -> None:
    """In a plan the mark of a start reaches out to where the robot looks."""
    preview = preview_of(tmp_path, room(), start("S", (0, 0, 60), yaw=16384))
    image = preview.top().astype(int)
    green = (image[:, :, 1] > 120) & (image[:, :, 0] < 60)
    x, y, _ = preview._grid(800, 600)
    assert y[green].min() < -0.3  # a quarter turn of Unreal is to the right
    assert y[green].max() < 0.2
    assert np.abs(x[green]).max() < 0.2


def test_points_in_sections() -> None:
    """Points are in a convex section or not; edges without length do not count."""
    square = np.array([[0.0, 0], [2, 0], [2, 0], [2, 2], [0, 2]])
    inside = covered(np.array([1.0, 3.0, 0.1]), np.array([1.0, 1.0, 1.9]), square)
    assert inside.tolist() == [True, False, True]


def test_cuts_leave_sight_alone(tmp_path: Path) -> None:
    """Pictures are only pictures: rays in the world meet its walls where they were."""
    world = import_text(tmp_path, level(room(), start("S", (0, 0, 60))))
    Preview(world.description).view(1)
    assert world.rays((0.0, 0.0, 1.0), AXES) == pytest.approx([2, 2, 2, 2, 2, 1], abs=1e-5)


FLOOR = "<material><diffuse>1 0 0 1</diffuse></material>"
CEILING = "<material><diffuse>0 0 1 1</diffuse></material>"


def slab(name: str, size: str, height: float, look: str) -> str:
    """A level box of a colour; the height is that of its lower side."""
    thick = float(size.split()[2])
    geometry = f"<box><size>{size}</size></box>"
    return model(name, shape(geometry, f"0 0 {height + thick / 2.0} 0 0 0", look))


@pytest.mark.parametrize("height", [0.6, 1.2, 1.9, 2.5])
def test_low_ceilings_hide_nothing(tmp_path: Path, height: float) -> None:
    """However low the ceiling over a floor, plan and views show the floor and not the ceiling."""
    text = slab("floor", "10 8 0.2", -0.2, FLOOR) + slab("ceiling", "10 8 0.2", height, CEILING)
    world = build_world(tmp_path, load(tmp_path, text + PLUGIN.replace("1.5,-2", "1,1")))
    preview = Preview(world.description)
    for image in (preview.top(), *(preview.view(corner) for corner in range(4))):
        red, _, blue = (image[:, :, k].astype(int) for k in range(3))
        assert (red > blue + 60).mean() > 0.1
        assert (blue > red + 100).mean() < 0.001


def test_tables_are_no_ceilings(tmp_path: Path) -> None:
    """What lies above less than half of the floor is seen from above, as it was."""
    table = slab("table", "4 4 0.1", 0.8, CEILING)
    text = slab("floor", "10 8 0.2", -0.2, FLOOR) + table + PLUGIN
    image = Preview(build_world(tmp_path, load(tmp_path, text)).description).top().astype(int)
    assert (image[:, :, 2] > image[:, :, 0] + 60).mean() > 0.05


class TestPictures:
    """Previews of two rooms, checked by content."""

    @pytest.fixture
    def world(self, tmp_path: Path) -> WorldDescription:
        """The rooms."""
        return import_text(tmp_path, two_rooms()).description

    def test_six_pictures_are_written(self, tmp_path: Path, world: WorldDescription) -> None:
        """Plan, slice and four views are PNG files."""
        paths = write_previews(world, tmp_path / "p")
        assert [p.stem for p in paths] == ["top", "slice", "view1", "view2", "view3", "view4"]
        for path in paths:
            with Image.open(path) as image:
                assert image.size == (800, 600)
                assert len(np.unique(np.asarray(image))) > 1

    def test_the_slice_shows_walls_and_the_doorway(self, world: WorldDescription) -> None:
        """At the height of a laser the wall between the rooms is drawn, its doorway is not."""
        preview = Preview(world)
        image = preview.slice()[:, :, 0]
        x, y, _ = preview._grid(800, 600)

        def dark(at_x: float, low: float, high: float) -> float:
            columns = np.flatnonzero(np.abs(x[0] - at_x) < 0.03)
            rows = np.flatnonzero((y[:, 0] > low) & (y[:, 0] < high))
            return float((image[np.ix_(rows, columns)].min(axis=1) < 128).mean())

        assert dark(2.0, -1.8, -0.6) > 0.95
        assert dark(2.0, 0.6, 1.8) > 0.95
        assert dark(2.0, -0.4, 0.4) < 0.05

    def test_the_plan_marks_starts(self, world: WorldDescription) -> None:
        """Green dots stand where robots start; +y is up."""
        preview = Preview(world)
        image = preview.top().astype(int)
        x, y, _ = preview._grid(800, 600)
        green = (image[:, :, 1] > 120) & (image[:, :, 0] < 60)
        rows, columns = np.nonzero(green)
        places = {
            (round(float(x[0, c]) * 2) / 2, round(float(y[r, 0]) * 2) / 2)
            for r, c in zip(rows, columns, strict=True)
        }
        assert (0.0, 0.0) in places
        assert (0.0, -1.5) in places
        assert (0.0, 1.5) not in places
