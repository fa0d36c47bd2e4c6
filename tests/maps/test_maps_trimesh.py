"""Formats that trimesh reads for us (worlds reference 13)."""

from __future__ import annotations

import io
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_samples import (
    FACES,
    WEDGE,
    WEDGE_PLACES,
    damages,
    places,
    read,
    refused,
    survives,
    volume,
    whole,
)

from usarsim_maps.meshes import trimesh_files

OFF = "OFF\n# by hand\n4 4 6\n" + "".join(
    [*("{:g} {:g} {:g}\n".format(*point) for point in WEDGE),
     *("3 {} {} {}\n".format(*face) for face in FACES)]
)  # fmt: skip


def threemf(unit: str = "millimeter") -> bytes:
    """The wedge and its copy 5 units further, as slicers write it."""
    vertices = "".join('<vertex x="{:g}" y="{:g}" z="{:g}"/>'.format(*p) for p in WEDGE)
    triangles = "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*f) for f in FACES)
    model = (
        '<?xml version="1.0" encoding="UTF-8"?>'
        f'<model unit="{unit}" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
        f'<resources><object id="1" name="Wedge" type="model"><mesh><vertices>{vertices}</vertices>'
        f"<triangles>{triangles}</triangles></mesh></object></resources>"
        '<build><item objectid="1"/>'
        '<item objectid="1" transform="1 0 0 0 1 0 0 0 1 5 0 0"/></build></model>'
    )
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", model)
    return stream.getvalue()


def xaml() -> str:
    """The wedge as SolidWorks writes it."""
    positions = " ".join(f"{value:g}" for value in WEDGE[FACES.ravel()].ravel())
    normals = " ".join("0 0 1" for _ in range(12))
    indices = " ".join(str(number) for number in range(12))
    return (
        '<ModelVisual3D xmlns="http://schemas.microsoft.com/winfx/2006/xaml/presentation">'
        "<ModelVisual3D.Content><GeometryModel3D><GeometryModel3D.Geometry>"
        f'<MeshGeometry3D Positions="{positions}" Normals="{normals}" TriangleIndices="{indices}"/>'
        "</GeometryModel3D.Geometry><GeometryModel3D.Material><DiffuseMaterial>"
        '<DiffuseMaterial.Brush><SolidColorBrush Color="#FF0000" Opacity="1.0"/>'
        "</DiffuseMaterial.Brush></DiffuseMaterial></GeometryModel3D.Material></GeometryModel3D>"
        "</ModelVisual3D.Content></ModelVisual3D>"
    )


def write(folder: Path, content: bytes | str, name: str) -> Path:
    """A file."""
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_off(tmp_path: Path) -> None:
    """One mesh; what the unit is was assumed."""
    scene = read(write(tmp_path, OFF, "map.off"))
    assert places(whole(scene)) == WEDGE_PLACES
    assert volume(whole(scene)) == pytest.approx(1.0)
    assert scene.source.assumed
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
    """Faces and their colour."""
    scene = read(write(tmp_path, xaml(), "map.xaml"))
    assert places(whole(scene)) == WEDGE_PLACES
    (material,) = scene.materials.values()
    assert material.color == pytest.approx((1.0, 0.0, 0.0, 1.0))


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error says how to get it."""
    monkeypatch.setitem(sys.modules, "trimesh", None)
    message = refused(write(tmp_path, OFF, "map.off"))
    assert "OFF files need the Python package 'trimesh'" in message
    assert 'pip install "usarsim-server[meshes]"' in message


@pytest.mark.parametrize(
    ("content", "name", "told"),
    [
        (OFF[:40], "map.off", "map.off"),
        ("OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "map.off", "triangles"),
        (b"no archive", "map.3mf", "map.3mf"),
        (threemf()[:-30], "map.3mf", "damaged archive"),
        ("<broken", "map.xaml", "map.xaml"),
    ],
)
def test_what_is_wrong(tmp_path: Path, content: bytes | str, name: str, told: str) -> None:
    """One line that names the file (item 73)."""
    message = refused(write(tmp_path, content, name))
    assert told in message
    assert "\n" not in message


def test_archive_that_unpacks_to_more_than_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Is refused before it is unpacked."""
    monkeypatch.setattr(trimesh_files, "MAX_BYTES", 4 << 20)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for number in range(5):
            archive.writestr(f"{number}.bin", bytes(1 << 20))
    assert "MiB when unpacked" in refused(write(tmp_path, stream.getvalue(), "map.3mf"))


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.one_of(
        damages(OFF.encode()).map(lambda content: ("map.off", content)),
        damages(threemf()).map(lambda content: ("map.3mf", content)),
        damages(xaml().encode()).map(lambda content: ("map.xaml", content)),
    )
)
def test_damaged_files(tmp_path_factory: pytest.TempPathFactory, found: tuple[str, bytes]) -> None:
    """Are read or refused, nothing else (item 73)."""
    survives(tmp_path_factory.mktemp("trimesh"), *found)
