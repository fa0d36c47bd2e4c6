"""Pictures of maps: what pixels mean, whatever the picture's mode, its greys and its noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mesh_samples import read, refusal
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from usarsim_maps.grids.occupancy import load_grid
from usarsim_maps.grids.shades import picture_cells, read_shades
from usarsim_maps.reader import Context
from usarsim_server.base.files import Folders

Pixels = NDArray[np.uint8]
Mask = NDArray[np.bool_]

YAML = "image: {}\nresolution: 0.1\norigin: [-3, -2, 0]\noccupied_thresh: 0.65\nfree_thresh: {}\n"


def room() -> Mask:
    """Walls of 60 x 40 cells: a room with a wall in it that leaves a door."""
    walls = np.zeros((40, 60), dtype=bool)
    walls[[0, -1], :] = True
    walls[:, [0, -1]] = True
    walls[11:, 30] = True
    return walls


def drawn(wall: int, floor: int) -> Pixels:
    """The room in two greys."""
    return np.where(room(), wall, floor).astype(np.uint8)


def wall_cells(picture: Image.Image, folder: Path, name: str = "map.png", **how: int) -> Mask:
    """Walls that are read from a picture."""
    picture.save(folder / name, **how)
    return picture_cells(read_shades(folder / name)).walls


class TestPictureAlone:
    """A picture that says nothing about its greys."""

    @pytest.mark.parametrize(
        ("wall", "floor"),
        [(0, 255), (0, 205), (127, 195), (150, 220), (100, 250), (170, 255), (200, 240), (10, 60)],
    )
    def test_walls_are_the_darker_of_two_greys(self, tmp_path: Path, wall: int, floor: int) -> None:
        """Whatever the two greys are."""
        assert np.array_equal(wall_cells(Image.fromarray(drawn(wall, floor)), tmp_path), room())

    @pytest.mark.parametrize(("wall", "floor"), [(0, 255), (100, 250), (127, 195)])
    @pytest.mark.parametrize("quality", [75, 30])
    def test_noise_of_jpeg(self, tmp_path: Path, wall: int, floor: int, quality: int) -> None:
        """Compression changes greys by a few; at most one wall cell in fifty is lost."""
        picture = Image.fromarray(drawn(wall, floor))
        found = wall_cells(picture, tmp_path, "map.jpg", quality=quality)
        assert np.count_nonzero(found != room()) <= room().sum() // 50

    def test_modes(self, tmp_path: Path) -> None:
        """Palettes, one bit, 16 bits, opaque alpha, floats and printers' colours."""
        gray = Image.fromarray(drawn(127, 195))
        flat = Image.fromarray(drawn(0, 255))
        pictures = {
            "palette.png": gray.convert("RGB").quantize(4),
            "bit.png": flat.convert("1"),
            "deep.png": Image.fromarray(drawn(127, 195).astype(np.uint16) * 257),
            "shallow.png": Image.fromarray(drawn(127, 195).astype(np.uint16)),
            "opaque.png": gray.convert("RGBA"),
            "la.png": gray.convert("LA"),
            "print.tif": flat.convert("CMYK"),
            "float.tif": Image.fromarray(drawn(127, 195).astype(np.float32) / 255.0),
        }
        for name, picture in pictures.items():
            assert np.array_equal(wall_cells(picture, tmp_path, name), room()), name

    def test_colours(self, tmp_path: Path) -> None:
        """Red walls on white."""
        pixels = np.full((40, 60, 3), 255, np.uint8)
        pixels[room()] = (255, 0, 0)
        assert np.array_equal(wall_cells(Image.fromarray(pixels), tmp_path), room())

    def test_a_few_black_pixels_are_not_the_only_walls(self, tmp_path: Path) -> None:
        """Grey walls stay walls where something is written in black."""
        pixels = drawn(127, 195)
        pixels[20, 10:14] = 0
        found = wall_cells(Image.fromarray(pixels), tmp_path)
        assert np.array_equal(found, room() | (pixels == 0))

    def test_smooth_edges(self, tmp_path: Path) -> None:
        """Where a drawing goes from black to white in steps, half is the border."""
        walls = np.kron(room(), np.ones((4, 4), dtype=bool))
        picture = Image.fromarray(np.where(walls, 0, 255).astype(np.uint8))
        smooth = picture.filter(ImageFilter.GaussianBlur(0.8))
        assert np.array_equal(wall_cells(smooth, tmp_path), walls)

    @pytest.mark.parametrize("unseen", [205, 128])
    def test_grey_around_a_building_is_no_wall(self, tmp_path: Path, unseen: int) -> None:
        """The grey of what nobody has seen: 205 is unknown; another one is free, but doubtful."""
        pixels = np.full((100, 120), unseen, np.uint8)
        pixels[30:70, 30:90] = drawn(0, 254)
        path = tmp_path / "map.png"
        Image.fromarray(pixels).save(path)
        cells = picture_cells(read_shades(path))
        assert np.array_equal(cells.walls, pixels == 0)
        sure = cells.free & ~cells.doubtful
        assert np.array_equal(sure, pixels == 254)
        assert cells.free.sum() == (sure.sum() if unseen == 205 else (pixels > 0).sum())

    def test_walls_on_nothing(self, tmp_path: Path) -> None:
        """Transparent cells are unknown, but free where nothing but walls is drawn."""
        picture = Image.new("RGBA", (60, 40), (0, 0, 0, 0))
        picture.paste((0, 0, 0, 255), mask=Image.fromarray((room() * 255).astype(np.uint8)))
        assert np.array_equal(wall_cells(picture, tmp_path), room())
        assert np.array_equal(picture_cells(read_shades(tmp_path / "map.png")).free, ~room())
        pixels = np.array(picture)
        pixels[5:20, 5:25] = 255
        Image.fromarray(pixels).save(tmp_path / "map.png")
        assert picture_cells(read_shades(tmp_path / "map.png")).free.sum() == 15 * 20

    def test_one_grey_has_no_walls(self, tmp_path: Path) -> None:
        """Noise of a few greys is not a building."""
        noise = np.random.default_rng(1).integers(235, 250, (40, 60)).astype(np.uint8)
        Image.fromarray(noise).save(tmp_path / "map.png")
        assert "not one wall" in refusal(lambda: read(tmp_path / "map.png"))


class TestMapServers:
    """A YAML file says what the greys mean."""

    def cells(
        self, folder: Path, pixels: NDArray[np.generic], text: str, free: float = 0.196
    ) -> tuple[Mask, Mask]:
        """Walls and free cells, the top row first."""
        Image.fromarray(pixels).save(folder / "map.png")
        path = folder / "map.yaml"
        path.write_text(YAML.format("map.png", free) + text)
        grid = load_grid(path, Context(folders=Folders([folder])))
        return grid.walls[::-1], grid.free[::-1]

    def test_scale_takes_opaque_cells_only(self, tmp_path: Path) -> None:
        """Each alpha below 255 is unknown, of dark cells and of light ones."""
        pixels = np.array([[[0, 0, 0, a], [254, 254, 254, a]] for a in (0, 1, 254, 255)], np.uint8)
        walls, free = self.cells(tmp_path, pixels, "mode: scale\n")
        assert walls.tolist() == [[False, False]] * 3 + [[True, False]]
        assert free.tolist() == [[False, False]] * 3 + [[False, True]]

    def test_trinary_counts_alpha_as_a_channel(self, tmp_path: Path) -> None:
        """Clear white gives 191 of 255, unknown; opaque 205 gives 218, free."""
        row = [
            [0, 0, 0, 0],
            [0, 0, 0, 255],
            [255, 255, 255, 0],
            [205, 205, 205, 255],
            [89, 89, 89, 255],
        ]
        walls, free = self.cells(tmp_path, np.array([row], np.uint8), "mode: trinary\n")
        assert walls.tolist() == [[True, True, False, False, False]]
        assert free.tolist() == [[False, False, False, True, False]]

    def test_raw_above_a_hundred_is_unknown(self, tmp_path: Path) -> None:
        """Per cent; neither alpha nor negate counts."""
        row = [
            [g, g, g, a]
            for g, a in ((0, 0), (66, 128), (65, 255), (100, 255), (101, 255), (255, 0))
        ]
        for text in ("mode: raw\n", "mode: raw\nnegate: 1\n"):
            walls, free = self.cells(tmp_path, np.array([row], np.uint8), text)
            assert walls.tolist() == [[False, True, False, True, False, False]]
            assert free.tolist() == [[True, False, False, False, False, False]]

    def test_negate(self, tmp_path: Path) -> None:
        """Light is occupied, and the grey of unknown cells is 50 of 255."""
        pixels = np.full((40, 60), 50, np.uint8)
        pixels[10:30, 10:30] = 1
        pixels[[10, 29], 10:30] = 255
        pixels[10:30, [10, 29]] = 255
        walls, free = self.cells(tmp_path, pixels, "negate: 1\n", free=0.25)
        assert np.array_equal(walls, pixels == 255)
        assert free.sum() == (pixels < 255).sum()
        grid = load_grid(tmp_path / "map.yaml", Context(folders=Folders([tmp_path])))
        assert np.array_equal(grid.doubtful[::-1], pixels == 50)

    def test_sixteen_bits(self, tmp_path: Path) -> None:
        """Samples of 16 bits mean the same."""
        deep = np.where(room(), 0, 254).astype(np.uint16) * 257
        walls, free = self.cells(tmp_path, deep, "")
        assert np.array_equal(walls, room())
        assert np.array_equal(free, ~room())

    def test_modes_have_names(self, tmp_path: Path) -> None:
        """A mode that no map server has is refused."""
        message = refusal(lambda: self.cells(tmp_path, drawn(0, 254), "mode: quaternary\n"))
        assert "mode: 'quaternary' is no mode" in message
        assert "trinary, scale, raw" in message
