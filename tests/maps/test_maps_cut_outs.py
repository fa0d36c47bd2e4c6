"""Holes that the opacity of pictures makes in what is seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from usarsim_maps.build.cut_outs import CutOuts, Finish, Stencil, glass, opacities, stencil_of
from usarsim_maps.build.looks import Look
from usarsim_maps.build.materials import finish_materials
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Material, Opacity

Array = NDArray[np.float64]

QUAD = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
TWO = np.array([[0, 1, 2], [0, 2, 3]])


def checks(size: int, cells: int = 2) -> NDArray[np.bool_]:
    """Pixels of a board, opaque below on the left and, of two cells, above on the right."""
    row = np.arange(size) * cells // size
    return np.asarray((row[::-1, None] + row) % 2 == 0)


def panel(tiles: float = 1.0, shift: float = 0.0) -> Look:
    """A square metre with a picture that is there some times along each side."""
    return Look("m", QUAD[TWO], QUAD[TWO][:, :, :2] * tiles + shift)


def cutter(stencil: Stencil | None, findings: Findings) -> CutOuts:
    """For one material."""
    return CutOuts({"m": Finish("m", (1.0, 1.0, 1.0, 1.0), None, stencil)}, findings)


def area(look: Look) -> float:
    """m^2."""
    a, b, c = (look.corners[:, k] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


def covers(look: Look, x: float, y: float) -> bool:
    """Whether a place of the panel is there."""
    for triangle in look.corners[:, :, :2]:
        weights = np.linalg.solve(np.vstack([triangle.T, np.ones(3)]), np.array([x, y, 1.0]))
        if (weights >= -1e-9).all():
            return True
    return False


class TestCuts:
    """Triangles along the cells of a picture."""

    @pytest.mark.parametrize("size", [2, 64, 300])
    def test_a_board(self, findings: Findings, size: int) -> None:
        """Half of it is there, where the picture is opaque, with the same coordinates."""
        look = cutter(stencil_of(checks(size), True), findings).cut(panel(), "m")
        assert area(look) == pytest.approx(0.5)
        assert covers(look, 0.2, 0.1)
        assert covers(look, 0.7, 0.9)
        assert not covers(look, 0.2, 0.9)
        assert look.uvs is not None
        assert look.uvs == pytest.approx(look.corners[:, :, :2])
        (note,) = findings.warnings()
        assert (note.subject, note.times) == ("m", 1)
        assert "cameras and lasers see through the holes" in note.text

    @pytest.mark.parametrize("shift", [0.0, -7.0, 3.25])
    def test_repeated(self, findings: Findings, shift: float) -> None:
        """Each copy of the picture has its holes."""
        look = cutter(stencil_of(checks(8), True), findings).cut(panel(5.0, shift), "m")
        assert area(look) == pytest.approx(0.5, abs=0.01)
        if shift == -7.0:
            assert covers(look, 0.81, 0.81)
            assert not covers(look, 0.81, 0.99)

    def test_not_repeated(self, findings: Findings) -> None:
        """Outside of the picture its edges go on."""
        look = cutter(stencil_of(checks(8), False), findings).cut(panel(4.0, -2.0), "m")
        assert covers(look, 0.1, 0.1)
        assert covers(look, 0.9, 0.9)
        assert not covers(look, 0.1, 0.9)
        assert area(look) == pytest.approx(0.625**2 + 0.375**2)

    def test_small_triangles(self, findings: Findings) -> None:
        """Those within one cell stay as they are, or go."""
        steps = np.linspace(0.0, 1.0, 9)
        corners = np.concatenate(
            [
                (QUAD * [0.125, 0.125, 1.0] + [x, y, 0.0])[TWO]
                for x in steps[:-1]
                for y in steps[:-1]
            ]
        )
        look = Look("m", corners, corners[:, :, :2].copy())
        cut = cutter(stencil_of(checks(8), True), findings).cut(look, "m")
        assert len(cut.corners) == len(corners) / 2
        assert area(cut) == pytest.approx(0.5)

    def test_triangles_without_a_place_in_the_picture(self, findings: Findings) -> None:
        """Where all corners have one coordinate, its pixel counts."""
        for u, there in ((0.2, True), (0.7, False)):
            look = Look("m", QUAD[TWO], np.full((2, 3, 2), 0.1) + np.array([u - 0.1, 0.0]))
            other = panel()
            both = Look(
                "m",
                np.concatenate([look.corners, other.corners + 5.0]),
                np.concatenate([look.uvs, other.uvs]),  # type: ignore[list-item]
            )
            cut = cutter(stencil_of(checks(8), True), findings).cut(both, "m")
            assert covers(cut, 0.5, 0.4) is there

    @pytest.mark.parametrize("tiles", [1e3, 1e9])
    def test_too_much(self, findings: Findings, tiles: float) -> None:
        """Thousands of copies are not cut, and that is said."""
        look = cutter(stencil_of(checks(8), True), findings).cut(panel(tiles), "m")
        assert look.corners == pytest.approx(panel().corners)
        assert "cameras and lasers see no hole" in findings.warnings()[0].text

    def test_nothing_left(self, findings: Findings) -> None:
        """What lies in the holes alone is not meant to be nothing."""
        look = Look("m", QUAD[TWO], QUAD[TWO][:, :, :2] * 0.1 + [0.05, 0.8])
        assert area(cutter(stencil_of(checks(8), True), findings).cut(look, "m")) == 1.0
        assert "it was left whole" in findings.warnings()[0].text


class TestPictures:
    """From a picture to its cells."""

    def test_wires_are_not_lost(self) -> None:
        """Where the cells would be all holes, or none, or half the picture more, there are none."""
        fence = np.zeros((512, 512), dtype=bool)
        fence[::32] = True
        fence[:, ::32] = True
        assert stencil_of(fence, True) is None
        assert stencil_of(~fence, True) is None
        noise = np.random.default_rng(1).random((256, 256)) < 0.5
        assert stencil_of(noise, True) is None

    def test_coarser_cells(self) -> None:
        """A disc of 300 pixels is one of 64 cells, or of fewer."""
        y, x = np.mgrid[:300, :300] - 149.5
        found = stencil_of(x**2 + y**2 < 120**2, True)
        assert found is not None
        assert found.opaque.mean() == pytest.approx(np.pi * 120**2 / 300**2, rel=0.05)

    def test_channels(self) -> None:
        """Alpha, of pictures with a palette too; brightness where there is none; their inverse."""
        rgba = Image.new("RGBA", (1, 1), (255, 255, 255, 51))
        grey = Image.new("L", (1, 1), 204)
        own, mask = Opacity(), Opacity(picture=b"")
        assert opacities(rgba, own) == pytest.approx(0.2)
        assert opacities(rgba, mask) == pytest.approx(0.2)
        assert opacities(rgba, Opacity(b"", bright=True, inverse=True)) == pytest.approx(0.0)
        assert opacities(grey, own) is None
        assert opacities(grey, mask) == pytest.approx(0.8)
        assert opacities(grey, Opacity(b"", inverse=True)) == pytest.approx(0.2)
        palette = rgba.convert("P")
        palette.info["transparency"] = 0
        assert opacities(palette, own) is not None

    def test_glass(self) -> None:
        """A picture that is partly clear all over has an opacity and no holes."""
        assert glass(np.full((4, 4), 0.3)) == pytest.approx(0.3)
        assert glass(checks(8).astype(float)) is None

    @pytest.mark.parametrize(
        ("values", "opacity", "color", "has_holes", "told"),
        [
            (np.full((4, 4), 128), Opacity(blend=True), 0.5, False, ""),
            (np.full((4, 4), 128), Opacity(cutoff=0.4), 1.0, False, ""),
            (np.full((4, 4), 0), Opacity(), 1.0, False, "wholly clear"),
            (checks(4) * 255, Opacity(blend=True), 1.0, True, ""),
            (np.full((4, 4), 255), Opacity(blend=True), 1.0, False, ""),
            (checks(4) * 255, None, 1.0, False, ""),
        ],
    )
    def test_finished(
        self,
        tmp_path: Path,
        findings: Findings,
        values: Array,
        opacity: Opacity | None,
        color: float,
        has_holes: bool,
        told: str,
    ) -> None:
        """Holes, glass, and what is clear by mistake."""
        picture = Image.new("RGB", (4, 4), (9, 9, 9))
        picture.putalpha(Image.fromarray(values.astype(np.uint8)))
        picture.save(tmp_path / "a.png")
        material = Material("m", (1.0, 1.0, 1.0, 1.0), tmp_path / "a.png", opacity=opacity)
        finish = finish_materials({"m": material}, ["m"], tmp_path / "out", findings)["m"]
        assert finish.color[3] == pytest.approx(color, abs=0.01)
        assert (finish.stencil is not None) is has_holes
        assert told in "".join(note.text for note in findings.warnings())
        assert bool(findings.warnings()) is bool(told)
