"""Occupancy grids: map server YAML, pictures, MRESim's text (exploration reference 3)."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from built_worlds import World, build_world
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_samples import FUZZ, damages, read, refusal, survives
from numpy.typing import NDArray
from PIL import Image

from usarsim_maps.convert import Request, import_map
from usarsim_maps.findings import Findings
from usarsim_maps.grids import occupancy
from usarsim_maps.grids.grid import free_places, rectangles
from usarsim_maps.scene import Mesh, Scene
from usarsim_server.cli import main
from usarsim_server.simulation.frames import rpy_from_quaternion
from usarsim_server.testing import Rehearsal

Pixels = NDArray[np.uint8]

YAML = "image: {}\nresolution: 0.1\norigin: [-3.0, -2.0, 0.0]\nnegate: 0\n" \
       "occupied_thresh: 0.65\nfree_thresh: 0.196\n"  # fmt: skip


def room() -> Pixels:
    """60 x 40 cells: a room with a wall in it that leaves a door of ten cells above."""
    pixels = np.full((40, 60), 254, dtype=np.uint8)
    pixels[[0, -1], :] = 0
    pixels[:, [0, -1]] = 0
    pixels[11:, 30] = 0
    return pixels


def write(folder: Path, pixels: Pixels, name: str = "map.pgm", yaml: str = "") -> Path:
    """A picture, and its YAML file if there is one; returns what to import."""
    Image.fromarray(pixels).save(folder / name)
    if not yaml:
        return folder / name
    path = (folder / name).with_suffix(".yaml")
    path.write_text(yaml)
    return path


def world(folder: Path, source: Path, **options: object) -> World:
    """Import and build."""
    return build_world(folder, read(source, None, **options))


def walls(scene: Scene) -> Mesh:
    """The mesh of all walls."""
    mesh = scene.objects[1].parts[0].shape
    assert isinstance(mesh, Mesh)
    return mesh


class TestYaml:
    """Maps of the map server."""

    @pytest.mark.parametrize("name", ["map.pgm", "map.png", "map.bmp"])
    def test_walls_are_where_they_should_be(self, tmp_path: Path, name: str) -> None:
        """Rays and contacts meet walls at the edges of cells, to a hair (worlds 56)."""
        built = world(tmp_path, write(tmp_path, room(), name, YAML.format(name)))
        # From (-1, 0): walls of one cell at x -3, y -2 and 2, and the inner wall at x 0.
        expected = [1.0, 1.9, 1.9, 1.9, np.inf, 0.5]
        assert built.rays((-1.0, 0.0, 0.5)) == pytest.approx(expected, abs=1e-5)
        solid = built.solid_rays((-1.0, 0.0, 0.5))[:5]
        assert solid == pytest.approx(expected[:5], abs=1e-5)

    def test_the_door_is_above(self, tmp_path: Path) -> None:
        """The top row of the picture is at the highest y: maps are not upside down (worlds 9)."""
        built = world(tmp_path, write(tmp_path, room(), yaml=YAML.format("map.pgm")))
        east = np.array([[1.0, 0.0, 0.0]])
        assert built.rays((-1.0, 1.4, 0.5), east)[0] == pytest.approx(3.9)
        assert built.rays((-1.0, -1.4, 0.5), east)[0] == pytest.approx(1.0)

    def test_height_and_scale(self, tmp_path: Path) -> None:
        """Walls are as high as the user says; so are cells as large."""
        source = write(tmp_path, room(), yaml=YAML.format("map.pgm"))
        scene = read(source, wall_height=3.5)
        assert walls(scene).vertices[:, 2].max() == 3.5
        assert not scene.source.assumed
        assert walls(read(source)).vertices[:, 2].max() == occupancy.WALL_HEIGHT
        assert walls(read(source, scale=5.0)).vertices[:, 0].max() == pytest.approx(12.0)

    def test_origin_with_a_heading(self, tmp_path: Path) -> None:
        """A yaw of the origin turns the map about its lower left corner."""
        yaml = YAML.format("map.pgm").replace("-2.0, 0.0]", "-2.0, 1.5707963]")
        built = world(tmp_path, write(tmp_path, room(), yaml=yaml))
        # The inner wall, 3 m along the old x, now lies along x at y = -2 + 3.
        north = np.array([[0.0, 1.0, 0.0]])
        assert built.rays((-4.0, 0.0, 0.5), north)[0] == pytest.approx(1.0, abs=1e-5)

    def test_negate_thresholds_and_modes(self, tmp_path: Path) -> None:
        """negate turns black and white round; raw pixels are per cent."""
        cases = {
            "negate: 0": (255 - 200, 254),
            "negate: 1": (200, 0),
            "mode: raw": (90, 0),
        }
        for text, (wall, free) in cases.items():
            pixels = np.where(room() == 0, wall, free).astype(np.uint8)
            yaml = YAML.format("map.pgm").replace("negate: 0", text)
            scene = read(write(tmp_path, pixels, yaml=yaml))
            assert len(walls(scene).hulls) == 5, text
            assert len(scene.starts) == occupancy.STARTS, text

    def test_unknown_cells_are_no_walls_and_no_starts(self, tmp_path: Path) -> None:
        """Grey is neither wall nor free."""
        pixels = np.where(room() == 0, 0, 205).astype(np.uint8)
        pixels[20:32, 5:17] = 254
        for yaml in (YAML.format("map.pgm"), ""):
            scene = read(write(tmp_path, pixels, yaml=yaml), scale=10.0)
            assert len(walls(scene).hulls) == 5
            corner = scene.objects[1].pose.position
            for start in scene.starts:
                x, y, _ = start.pose.position
                assert 0.5 < x - corner[0] < 1.7
                assert 0.8 < y - corner[1] < 2.0
            (tmp_path / "map.yaml").unlink(missing_ok=True)

    def test_a_picture_with_its_yaml(self, tmp_path: Path, findings: Findings) -> None:
        """Given the picture alone, the YAML file beside it counts all the same."""
        write(tmp_path, room(), yaml=YAML.format("map.pgm"))
        scene = read(tmp_path / "map.pgm", findings)
        assert not scene.source.assumed
        assert scene.objects[1].pose.position[:2] == (-3.0, -2.0)
        assert "map.yaml" in findings.warnings()[0].text

    def test_yaml_as_people_write_it(self, tmp_path: Path) -> None:
        """Comments, quotes, block lists, lists over several lines, nested tables."""
        text = (
            '---\n# a map\nimage: "my # map.pgm"  # beside\norigin:\n  - -1.0\n  - 2\n  - 0\n'
            "other: [1,\n  2,\n  3]\nextra:\n  inner: 5\nempty:\n"
            'windows: "C:\\maps\\a.pgm"\ntabs:\t1\n'
        )
        assert occupancy.read_yaml(tmp_path, text) == {
            "image": "my # map.pgm",
            "origin": ["-1.0", "2", "0"],
            "other": ["1", "2", "3"],
            "extra": "",
            "empty": "",
            "windows": "C:/maps/a.pgm",
            "tabs": "1",
        }


class TestPictures:
    """Pictures alone."""

    def test_the_assumed_scale_is_stated(self, tmp_path: Path) -> None:
        """Without a scale 13 cells are a metre, and the report says it was assumed (worlds 42)."""
        scene = read(write(tmp_path, room()))
        assert scene.source.assumed
        assert scene.source.units_per_metre == pytest.approx(13.0)
        assert not read(write(tmp_path, room()), scale=20.0).source.assumed

    def test_cells_on_the_wire(self, tmp_path: Path) -> None:
        """x counts columns and wire y counts rows from the upper left, as in MRESim."""
        built = world(tmp_path, write(tmp_path, room()), scale=10.0)
        # Cell (column 10, row 20) is at wire (1.05, 2.05), simulation (1.05, -2.05).
        rays = built.rays((1.05, -2.05, 0.5))
        assert rays[:4] == pytest.approx([1.95, 0.95, 1.95, 1.85], abs=1e-5)

    def test_palettes_sixteen_bits_and_transparency(self, tmp_path: Path) -> None:
        """Kinds of pictures do not matter: dark is wall, transparent is unknown."""
        gray = Image.fromarray(room())
        gray.convert("RGB").quantize(4).save(tmp_path / "palette.png")
        Image.fromarray(room().astype(np.uint16) * 257).save(tmp_path / "deep.png")
        alpha = Image.fromarray(np.where(room() == 0, 255, 0).astype(np.uint8))
        clear = Image.new("RGBA", (60, 40), (0, 0, 0, 0))
        clear.paste((0, 0, 0, 255), mask=alpha)
        clear.save(tmp_path / "clear.png")
        for name in ("palette.png", "deep.png", "clear.png"):
            assert len(walls(read(tmp_path / name)).hulls) == 5, name

    def test_mirror(self, tmp_path: Path) -> None:
        """--mirror turns the picture upside down."""
        scene = read(write(tmp_path, room()), scale=10.0, mirror=True)
        built = build_world(tmp_path, scene)
        assert built.rays((1.05, 2.05, 0.5))[:4] == pytest.approx([1.95, 0.95, 1.85, 1.95])


class TestText:
    """MRESim's text form (exploration reference 3.2, E-06)."""

    def text(self, new_line: str = "\n") -> str:
        """The room."""
        rows = ["".join("1" if value == 0 else "0" for value in row) for row in room()]
        return new_line.join(["40", "60", *rows, ""])

    @pytest.mark.parametrize("new_line", ["\n", "\r\n"])
    def test_the_same_as_the_picture(self, tmp_path: Path, new_line: str) -> None:
        """Rows, columns, digits; LF and CRLF; the same walls as the picture has (E-06)."""
        path = tmp_path / "map.txt"
        path.write_bytes(self.text(new_line).encode())
        picture = read(write(tmp_path, room(), "other.png"), scale=13.0)
        scene = read(path)
        assert np.array_equal(walls(scene).vertices, walls(picture).vertices)
        assert scene.source.assumed

    @pytest.mark.parametrize(
        ("text", "told"),
        [
            ("", "line 1"),
            ("2\nx\n00\n00", "line 2"),
            ("2\n2\n00\n0", "line 4"),
            ("2\n2\n00\n02", "line 4"),
            ("2\n2\n00", "2 rows are announced, 1 are there"),
            ("1\n2\n00\n00", "more rows"),
            ("99999999\n99999999\n0", "too many"),
            ("1\n1\n0", "not one wall"),
        ],
    )
    def test_errors(self, tmp_path: Path, text: str, told: str) -> None:
        """Errors name file and line (E-06)."""
        path = tmp_path / "map.txt"
        path.write_text(text)
        message = refusal(lambda: read(path))
        assert "map.txt" in message
        assert told in message


class TestWalls:
    """Few rectangles, exactly the cells."""

    @settings(max_examples=60, deadline=None)
    @given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 2**32 - 1))
    def test_rectangles_cover_exactly(self, rows: int, columns: int, seed: int) -> None:
        """Whatever the cells: every set one is in one rectangle, no other one is."""
        cells = np.random.default_rng(seed).random((rows, columns)) < 0.5
        count = np.zeros(cells.shape, dtype=int)
        for r in rectangles(cells):
            count[r.low : r.high, r.left : r.right] += 1
        assert np.array_equal(count, cells.astype(int))

    def test_long_walls_are_one(self) -> None:
        """A wall is one rectangle, along x as along y."""
        cells = np.zeros((300, 400), dtype=bool)
        cells[10:290, 20:22] = True
        cells[100, 30:390] = True
        assert len(rectangles(cells)) == 2
        assert len(rectangles(cells.T)) == 2

    def test_noise_is_made_coarser(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Too many boxes are bounded by joining cells, with a warning."""
        monkeypatch.setattr(occupancy, "MAX_WALLS", 100)
        noise = np.where(np.random.default_rng(1).random((64, 64)) < 0.3, 0, 255).astype(np.uint8)
        findings = Findings()
        scene = read(write(tmp_path, noise), findings)
        assert len(walls(scene).hulls) <= 100
        assert "too many walls" in findings.warnings()[0].text

    def test_walls_are_boxes(self, tmp_path: Path) -> None:
        """Contact geometry is boxes, not hulls (worlds 62)."""
        built = world(tmp_path, write(tmp_path, room(), yaml=YAML.format("map.pgm")))
        assert (built.model.geom_type[built.model.geom_group == 3] == 6).all()

    def test_import_is_deterministic(self, tmp_path: Path) -> None:
        """Two runs give the same boxes in the same order (worlds 75)."""
        noise = np.where(np.random.default_rng(2).random((50, 70)) < 0.3, 0, 255).astype(np.uint8)
        path = write(tmp_path, noise)
        assert np.array_equal(walls(read(path)).vertices, walls(read(path)).vertices)


class TestStarts:
    """Places to start from."""

    def test_the_origin_first(self, tmp_path: Path) -> None:
        """The first start is where mapping began, at (0, 0), if there is room; others are far."""
        yaml = YAML.format("map.pgm").replace("-3.0, -2.0", "-1.0, -1.0")
        scene = read(write(tmp_path, room(), yaml=yaml))
        places = np.array([start.pose.position[:2] for start in scene.starts])
        assert np.abs(places[0]).max() < 0.1
        assert [start.tag for start in scene.starts] == [f"RobotStart{k}" for k in (1, 2, 3, 4)]
        apart = np.linalg.norm(places[:, None] - places[None], axis=2)
        assert (apart[np.triu_indices(4, 1)] > 1.0).all()

    def test_all_in_one_region_with_room_around(self) -> None:
        """Sealed rooms get no starts; every place has room around it."""
        free = np.ones((100, 100), dtype=bool)
        free[:, 30] = False
        found = free_places(free, free, 0.1, (0.5, 5.0), 0.5, 10)
        assert len(found) > 4
        for x, y in found:
            assert x > 3.1 + 0.5
            assert 0.5 < x < 9.5
            assert 0.5 < y < 9.5

    def test_no_room_at_all(self, tmp_path: Path) -> None:
        """A map without a free place gets the start that the builder finds."""
        pixels = np.zeros((20, 20), dtype=np.uint8)
        pixels[::3] = 255
        assert not read(write(tmp_path, pixels)).starts
        assert len(world(tmp_path, write(tmp_path, pixels)).description.starts) == 1

    def test_a_robot_drives_there(self, tmp_path: Path) -> None:
        """A P3AT stands, drives, and is stopped by a wall (worlds 52, 55)."""
        yaml = YAML.format("map.pgm")
        source = write(tmp_path, room(), yaml=yaml)
        imported = import_map(Request(source, out=tmp_path / "out"))
        with Rehearsal(world=str(imported.folder)) as rehearsal:
            client = rehearsal.connect()
            client.send("INIT {ClassName USARBot.P3AT} {Name R} {Location -1.5,1,-0.25}")
            rehearsal.run(1.0)
            client.send("DRIVE {Left 5.0} {Right 5.0}")
            rehearsal.run(8.0)
            snapshot = rehearsal.assembly.simulation.look()
            x, y, z = snapshot.xpos[max(snapshot.layouts.items())[1].base]
        assert -1.0 < x < 0.0
        assert abs(y + 1.0) < 0.1
        assert 0.05 < z < 0.25


class TestBadFiles:
    """Errors."""

    @pytest.mark.parametrize(
        ("text", "told"),
        [
            ("resolution: 0.1\n", "image"),
            ("image: gone.pgm\nresolution: 0.1\n", "'gone.pgm' is missing"),
            ("image: map.pgm\n", "resolution: the number is missing"),
            ("image: map.pgm\nresolution: fine\n", "'fine' is no number"),
            ("image: map.pgm\nresolution: 0\n", "0 m per pixel"),
            ("image: map.pgm\nresolution: 0.1\norigin: [1, x]\n", "origin"),
            ("image: map.pgm\nresolution 0.1\n", "line 2"),
            ("image: [map.pgm\n", "map.yaml: line"),
            ("- map.pgm\n", "line 1: '- map.pgm' is not understood"),
            ('a: 1\nimage: "map.pgm\nresolution: 1\n', "line 2"),
            ("a: 1\n\nimage: a: b\n", "line 3"),
            ("a: 1\nb: \a\n", "line 2"),
            ("a: 1\nb: &x [*x]\n", "line 2"),
            ("a: 1\n? [b]\n: 2\n", "line 2"),
            ("image: !!python/name:os.system x\n", "'x' is missing"),
        ],
    )
    def test_yaml(self, tmp_path: Path, text: str, told: str) -> None:
        """Errors name file and key or line."""
        message = refusal(lambda: read(write(tmp_path, room(), yaml=text)))
        assert "map.yaml" in message
        assert told in message

    def test_absurd_pictures(self, tmp_path: Path) -> None:
        """A header of 10 gigapixels is refused before memory is taken; so is a cut file."""
        pgm = tmp_path / "map.pgm"
        pgm.write_bytes(b"P5\n100000 100000\n255\n\0\0")
        assert "far too many pixels" in refusal(lambda: read(pgm))
        pgm.write_bytes(b"P5\n9000 9000\n255\n\0\0")
        assert "9000 x 9000 pixels" in refusal(lambda: read(pgm))
        head = struct.pack(">II5B", 100_000, 100_000, 8, 0, 0, 0, 0)
        chunk = struct.pack(">I", 13) + b"IHDR" + head
        png = tmp_path / "map.png"
        png.write_bytes(
            b"\x89PNG\r\n\x1a\n" + chunk + struct.pack(">I", zlib.crc32(b"IHDR" + head))
        )
        assert "map.png" in refusal(lambda: read(png))
        write(tmp_path, room(), "cut.png")
        cut = tmp_path / "cut.png"
        cut.write_bytes(cut.read_bytes()[:60])
        assert "cannot be read" in refusal(lambda: read(cut))

    @settings(FUZZ, max_examples=60)
    @given(st.data())
    def test_damaged_files(self, tmp_path: Path, data: st.DataObject) -> None:
        """Whatever is wrong with a file, it is read or refused in one line."""
        write(tmp_path, room(), "map.png", YAML.format("map.png"))
        name = data.draw(st.sampled_from(["map.png", "map.yaml", "map.txt"]))
        content = (
            TestText().text().encode() if name == "map.txt" else (tmp_path / name).read_bytes()
        )
        survives(tmp_path, name, data.draw(damages(content)))

    @pytest.mark.parametrize("text", ["high", "-1", "nan", "1e9"])
    def test_the_option(
        self, tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """A wall height without sense is one error, exit code 2."""
        source = str(write(tmp_path, room()))
        assert main(["import", source, "--out", str(tmp_path), f"--wall-height={text}"]) == 2
        assert "--wall-height" in capsys.readouterr().err


def test_wall_height_in_the_sidecar_and_the_cache(tmp_path: Path) -> None:
    """The sidecar may say it; another height is another import (worlds 68, 74)."""
    source = write(tmp_path, room(), yaml=YAML.format("map.pgm"))
    first = import_map(Request(source))
    assert first.report.totals["wall height"] == 2.0
    source.with_suffix(".usarsim.toml").write_text("wall_height = 1.25\n")
    second = import_map(Request(source))
    assert not second.cached
    assert second.report.totals["wall height"] == 1.25


def test_a_heading_of_the_origin_turns_starts(tmp_path: Path) -> None:
    """Starts look along the map's own x axis."""
    yaml = YAML.format("map.pgm").replace("-2.0, 0.0]", "-2.0, 1.0]")
    scene = read(write(tmp_path, room(), yaml=yaml))
    assert rpy_from_quaternion(scene.starts[0].pose.quaternion)[2] == pytest.approx(1.0)
