"""Formats that trimesh reads for us (worlds reference 13)."""

from __future__ import annotations

import io
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from mesh_samples import OFF, read, refused, threemf, volume, whole, write, xaml

from usarsim_maps import archives


def test_thousands(tmp_path: Path) -> None:
    """A file without extension and with a scale."""
    scene = read(write(tmp_path, OFF, "map"), scale=1000.0)
    assert np.ptp(whole(scene).vertices) == pytest.approx(0.003)


def test_3mf_holds_its_unit_and_its_copies(tmp_path: Path) -> None:
    """Millimetres, and one mesh shown twice."""
    scene = read(write(tmp_path, threemf(), "map.3mf"))
    assert not scene.source.assumed
    assert scene.source.units_per_metre == pytest.approx(1000.0)
    first, second = scene.objects
    assert first.parts[0].shape is second.parts[0].shape
    assert second.pose.position == pytest.approx((0.005, 0.0, 0.0))
    assert volume(whole(scene)) == pytest.approx(2e-9)
    inches = read(write(tmp_path, threemf("inch"), "inch.3mf"))
    assert np.ptp(whole(inches).vertices[:, 2]) == pytest.approx(3 * 0.0254)


def test_xaml(tmp_path: Path) -> None:
    """The colour of faces."""
    scene = read(write(tmp_path, xaml(), "map.xaml"))
    (material,) = scene.materials.values()
    assert material.color == pytest.approx((1.0, 0.0, 0.0, 1.0))


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error says how to get it."""
    monkeypatch.setitem(sys.modules, "trimesh", None)
    message = refused(write(tmp_path, OFF, "map.off"))
    assert "OFF files need the Python package 'trimesh'" in message
    assert 'pip install "usarsim-server[meshes]"' in message


def test_archive_that_unpacks_to_more_than_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Is refused before it is unpacked."""
    monkeypatch.setattr(archives, "MAX_UNPACKED", 4 << 20)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for number in range(5):
            archive.writestr(f"{number}.bin", bytes(1 << 20))
    assert "MiB when unpacked" in refused(write(tmp_path, stream.getvalue(), "map.3mf"))


def test_colors_of_faces(tmp_path: Path) -> None:
    """Each face has its own colour."""
    shape = xaml()
    blue = shape[shape.index("<GeometryModel3D>") : shape.index("</ModelVisual3D.Content>")]
    both = shape.replace(
        blue, f"<Model3DGroup>{blue}{blue.replace('#FF0000', '#0000FF')}</Model3DGroup>"
    )
    scene = read(write(tmp_path, both, "map.xaml"))
    found = set()
    for thing in scene.objects:
        mesh = thing.parts[0].shape
        found |= {scene.materials[mesh.materials[slot]].color[:3] for slot in mesh.slots}
    assert found == {(1.0, 0.0, 0.0), (0.0, 0.0, 1.0)}
