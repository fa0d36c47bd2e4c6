"""Robots start inside of buildings, also where doors are open or the outside counts as free."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from mesh_samples import read
from numpy.typing import NDArray
from PIL import Image

from usarsim_maps.grids.inside import inside

Mask = NDArray[np.bool_]


def field(rows: int = 200, columns: int = 200) -> Mask:
    """Free cells without a wall."""
    return np.ones((rows, columns), dtype=bool)


def hall(door: int = 0) -> Mask:
    """80 x 80 cells in the middle of 200 x 200, with a door so wide in its east wall."""
    free = field()
    free[60:140, 60:140] = False
    free[61:139, 61:139] = True
    free[100 - door // 2 : 100 - door // 2 + door, 139] = True
    return free


def turned(free: Mask, degrees: float) -> Mask:
    """A map about its middle, walls two cells thick."""
    walls = cv2.dilate((~free).astype(np.uint8), np.ones((2, 2), np.uint8))
    matrix = cv2.getRotationMatrix2D((100.0, 100.0), degrees, 1.0)
    return np.asarray(
        cv2.warpAffine(walls, matrix, walls.shape[::-1], flags=cv2.INTER_NEAREST) == 0
    )


def middle(radius: int) -> Mask:
    """A disc about the middle."""
    rows, columns = np.indices((200, 200))
    return np.asarray(np.hypot(rows - 99.5, columns - 99.5) < radius)


@pytest.mark.parametrize("door", [0, 8, 20, 40])
def test_the_outside_of_a_hall(door: int) -> None:
    """Nothing outside is inside, however wide the door is; what does not face the door is."""
    found = inside(hall(door))
    box = np.zeros((200, 200), dtype=bool)
    box[60:140, 60:140] = True
    assert not (found & ~box).any()
    assert found[62, 62]
    assert found.sum() >= (78 - door) * 78


@pytest.mark.parametrize("degrees", [10.0, 30.0, 45.0])
def test_a_hall_that_is_turned(degrees: float) -> None:
    """Walls at any angle."""
    found = inside(turned(hall(), degrees))
    assert found[middle(30)].all()
    assert not found[~middle(60)].any()


def test_specks_far_away_do_not_count() -> None:
    """Single wall cells of noise outside change nothing inside."""
    free = hall(8)
    for row, column in ((3, 5), (190, 100), (100, 190), (150, 20)):
        free[row, column] = False
    found = inside(free)
    assert found[80, 80]
    assert not found[~middle(60)].any()


def test_maps_without_an_inside() -> None:
    """All free cells of an open field, of one with trees, and of a shed among trees."""
    assert inside(field()).all()
    trees = field()
    for row, column in ((20, 30), (150, 40), (90, 170), (60, 100)):
        trees[row : row + 4, column : column + 4] = False
    assert np.array_equal(inside(trees), trees)
    trees[100:110, 100:110] = False
    trees[101:109, 101:109] = True
    assert np.array_equal(inside(trees), trees)


def test_a_building_as_large_as_its_map() -> None:
    """Everything, also where the map ends in cells that are unknown."""
    free = field()
    free[[0, -1]] = False
    free[:, [0, -1]] = False
    free[50:150, 80] = False
    assert np.array_equal(inside(free), free)


def test_a_plan_without_outer_walls() -> None:
    """The rooms between the walls, not a closet that nothing can leave."""
    free = field()
    free[66, :] = free[132, :] = False
    free[:, 66] = free[:, 132] = False
    free[66, 90:100] = free[132, 90:100] = free[90:100, 66] = free[90:100, 132] = True
    free[10:20, 10:20] = False
    free[12:18, 12:18] = True
    assert inside(free)[110, 110]


def starts(folder: Path, pixels: NDArray[np.uint8], free: float) -> NDArray[np.float64]:
    """Where robots start on a map of 200 x 200 cells of 0.1 m about the origin."""
    Image.fromarray(pixels).save(folder / "map.pgm")
    (folder / "map.yaml").write_text(
        "image: map.pgm\nresolution: 0.1\norigin: [-10.0, -10.0, 0.0]\nnegate: 0\n"
        f"occupied_thresh: 0.65\nfree_thresh: {free}\n"
    )
    return np.array([start.pose.position[:2] for start in read(folder / "map.yaml").starts])


@pytest.mark.parametrize("outside", [205, 254])
@pytest.mark.parametrize("door", [0, 10])
def test_starts_are_inside(tmp_path: Path, outside: int, door: int) -> None:
    """Whatever grey the outside has, and if a door of 1 m is open."""
    free = hall(door)
    pixels = np.where(free, outside, 0).astype(np.uint8)
    pixels[61:139, 61:139] = 254
    found = starts(tmp_path, pixels, 0.25)
    assert found.shape == (4, 2)
    assert np.abs(found).max() <= 3.35 + 1e-9


def test_an_origin_outside(tmp_path: Path) -> None:
    """The first start is the place inside that is nearest to where mapping began."""
    pixels = np.full((200, 200), 254, np.uint8)
    pixels[60:140, 20:100] = 0
    pixels[61:139, 21:99] = 254
    found = starts(tmp_path, pixels, 0.196)
    assert found[0] == pytest.approx([-0.65, 0.0], abs=0.1)
    assert found[:, 0].max() < -0.5


def test_starts_on_an_open_map(tmp_path: Path) -> None:
    """A map without an inside is free everywhere, and the first start is at the origin."""
    pixels = np.full((200, 200), 254, np.uint8)
    pixels[20:24, 30:34] = pixels[150:154, 120:124] = 0
    found = starts(tmp_path, pixels, 0.196)
    assert np.abs(found[0]).max() < 0.1
    assert np.abs(found).max() > 8.0
