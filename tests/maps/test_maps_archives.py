"""Archives are looked through before they are unpacked."""

from __future__ import annotations

import io
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from mesh_samples import threemf

from usarsim_maps import archives
from usarsim_maps.archives import open_archive, read_archive
from usarsim_server.base.errors import MapImportError
from usarsim_server.cli import main

HEAD = '<model xmlns="m"><resources><object id="1"><mesh><triangles>'
TAIL = "</triangles></mesh></object></resources></model>"
TRIANGLE = '<triangle v1="0" v2="1" v3="2"/>'


def packed(files: dict[str, str]) -> bytes:
    """An archive of texts."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return stream.getvalue()


def many_triangles() -> bytes:
    """0.2 MB whose tree would take 2 GB."""
    return packed({"3D/3dmodel.model": HEAD + TRIANGLE * 2_000_000 + TAIL})


def large_file() -> bytes:
    """0.3 MB that grow to 300."""
    return packed({"Metadata/picture.png": "\0" * (300 << 20)})


def many_files() -> bytes:
    """More files than any map has."""
    return packed({str(number): "" for number in range(archives.MAX_ENTRIES + 1)})


def long_list() -> bytes:
    """A list of files that says to be large."""
    data = bytearray(threemf())
    place = data.rfind(b"PK\5\6")
    struct.pack_into("<I", data, place + 12, archives.MAX_DIRECTORY + 1)
    return bytes(data)


def wide_list() -> bytes:
    """The same in the record of large archives, which Python believes rather."""
    data = threemf()
    place = data.rfind(b"PK\5\6")
    size = archives.MAX_DIRECTORY + 1
    record = struct.pack("<4sQ2H2L4Q", b"PK\6\6", 44, 45, 45, 0, 0, 1, 1, size, 0)
    locator = struct.pack("<4sLQL", b"PK\6\7", 0, place, 1)
    return data[:place] + record + locator + data[place:]


BOMBS: dict[str, tuple[Callable[[], bytes], str]] = {
    "triangles": (many_triangles, "more than 1000000 elements of XML (export it as glTF"),
    "large": (large_file, "300 MiB when unpacked, more than 256 (split the map)"),
    "files": (many_files, "20001 files in the archive"),
    "list": (long_list, "a list of files of more than 8 MiB"),
    "wide list": (wide_list, "a list of files of more than 8 MiB"),
    "cut off": (lambda: threemf()[:-30], "a damaged archive"),
}


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_are_refused_before_they_are_unpacked(name: str, tmp_path: Path) -> None:
    """By one error, and within little memory."""
    make, told = BOMBS[name]
    path = tmp_path / "map.3mf"
    path.write_bytes(make())
    tracemalloc.start()
    try:
        with pytest.raises(MapImportError) as caught:
            read_archive(path, "export it again")
        used = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert told in str(caught.value)
    assert str(path) in str(caught.value)
    assert used < 64 << 20


def test_the_command_says_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`usarsim import` ends with code 2."""
    path = tmp_path / "map.3mf"
    path.write_bytes(many_triangles())
    assert main(["import", str(path), "--out", str(tmp_path / "out")]) == 2
    assert "elements of XML" in capsys.readouterr().err


def test_text_without_an_archive_has_a_bound_too(tmp_path: Path) -> None:
    """XAML is XML as it is."""
    path = tmp_path / "map.xaml"
    path.write_text("<a>" * 1_000_001)
    with pytest.raises(MapImportError, match="elements of XML"):
        read_archive(path, "export it again")


def test_a_usual_archive_is_opened(tmp_path: Path) -> None:
    """As it is."""
    path = tmp_path / "map.3mf"
    path.write_bytes(threemf())
    assert read_archive(path, "export it again") == threemf()
    with open_archive(path, io.BytesIO(threemf()), "") as archive:
        assert archive.namelist() == ["3D/3dmodel.model"]
