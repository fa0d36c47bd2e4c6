"""Damaged and hostile stages, and no library at all: one clear error each."""

from __future__ import annotations

import random
import sys
import zipfile
from pathlib import Path

import pytest
from mesh_samples import read, survives
from mesh_samples import refused as told

from usarsim_maps import apart
from usarsim_maps.convert import Request, import_map
from usarsim_server.base.errors import MapImportError
from usarsim_server.cli import main


def test_without_the_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where the USD library is not installed one error says how to get it; exit status 2."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "pxr"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pxr", None)
    source = tmp_path / "hall.usda"
    source.write_text("#usda 1.0\n")
    assert "pip install usd-core" in told(source)
    assert main(["import", str(source), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.count("pip install usd-core") == 1
    assert "Traceback" not in error


@pytest.fixture
def library() -> None:
    """Skips without the USD library."""
    pytest.importorskip("pxr", reason="usd-core is not installed: pip install usd-core")


@pytest.mark.usefixtures("library")
class TestDamage:
    """What the library refuses, and what it has to be kept from."""

    def test_syntax(self, tmp_path: Path) -> None:
        """A syntax error is told with its line; the world that was there stays (worlds 73)."""
        good = tmp_path / "hall.usda"
        good.write_text('#usda 1.0\n(\n metersPerUnit = 1\n)\ndef Cube "Box" {\n}\n')
        folder = import_map(Request(good, out=tmp_path / "out")).folder
        before = (folder / "scene.xml").read_bytes()
        good.write_text(
            '#usda 1.0\ndef Xform "W" {\n  def Mesh "m" {\n    point3f[] points = [(0,\n'
        )
        assert "line 5: " in told(good)
        with pytest.raises(MapImportError):
            import_map(Request(good, out=tmp_path / "out"))
        assert (folder / "scene.xml").read_bytes() == before

    def test_no_stages(self, tmp_path: Path) -> None:
        """Files that are something else are refused."""
        for name, content in {
            "a.usda": b"hello",
            "b.usdc": b"PXR-USDC" + bytes(40),
            "c.usd": b"",
            "d.usdz": b"PK nothing",
        }.items():
            (tmp_path / name).write_bytes(content)
            told(tmp_path / name)

    def test_empty_stage(self, tmp_path: Path) -> None:
        """A stage without geometry is no map."""
        (tmp_path / "a.usda").write_text("#usda 1.0\n")
        with pytest.raises(MapImportError, match="no geometry"):
            import_map(Request(tmp_path / "a.usda"))

    def test_units(self, tmp_path: Path) -> None:
        """A unit of no size is refused, unless the user knows it."""
        path = tmp_path / "a.usda"
        path.write_text('#usda 1.0\n(\n metersPerUnit = 0\n)\ndef Cube "Box" {\n}\n')
        assert "metersPerUnit is 0" in told(path)
        assert read(path, scale=1.0).objects

    def test_bombs(self, tmp_path: Path) -> None:
        """Archives with compressed files, and those that lie about sizes, are not unpacked."""
        path = tmp_path / "bomb.usdz"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("scene.usda", "#usda 1.0\n" + " " * 10_000_000)
        assert path.stat().st_size < 100_000
        assert "scene.usda is compressed" in told(path)
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("scene.usda", "#usda 1.0\n")
        content = bytearray(path.read_bytes())
        place = content.rindex(b"PK\x01\x02")
        content[place + 20 : place + 28] = b"\xff\xff\xff\x0f" * 2
        path.write_bytes(content)
        assert "more than the archive" in told(path)
        with zipfile.ZipFile(path, "w"):
            pass
        assert "0 files" in told(path)

    def test_flipped_bytes(self, tmp_path: Path) -> None:
        """Text with some bytes changed is read, or refused in one line (worlds 73)."""
        from usd_stages import box, moved, stage_at

        stage = stage_at(tmp_path / "a.usda")
        moved(box(stage, "/World/Box", (0, 0, 0), (1, 2, 3)), (1, 2, 3), (1, 1, 2))
        stage.GetRootLayer().Save()
        del stage
        content = (tmp_path / "a.usda").read_bytes()
        chosen = random.Random(3)
        for number in range(60):
            changed = bytearray(content)
            for _ in range(chosen.randint(1, 4)):
                changed[chosen.randrange(len(changed))] = chosen.choice(b'()[]"-9e.\0\xff@ \n')
            survives(tmp_path, f"fuzz{number}.usda", bytes(changed))

    def test_senseless_places(self, tmp_path: Path) -> None:
        """Infinite places and scales of zero are left out."""
        path = tmp_path / "a.usda"
        path.write_text(
            "#usda 1.0\n(\n metersPerUnit = 1\n)\n"
            'def Cube "Far" {\n double3 xformOp:translate = (inf, 0, nan)\n'
            ' uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
            'def Cube "Flat" {\n float3 xformOp:scale = (0, 0, 0)\n'
            ' uniform token[] xformOpOrder = ["xformOp:scale"]\n}\n'
            'def Cube "Good" {\n}\n'
        )
        assert [thing.name for thing in read(path).objects] == ["Good"]

    def test_values_of_other_types(self, tmp_path: Path) -> None:
        """Attributes that hold something else than they should count as absent."""
        path = tmp_path / "a.usda"
        path.write_text(
            '#usda 1.0\n(\n upAxis = "Z"\n)\n'
            'def Mesh "A" {\n color3d points = (1, 2, 3)\n}\n'
            'def Mesh "B" {\n string points = "none"\n int[] faceVertexCounts = [3]\n}\n'
            'def SphereLight "C" {\n string inputs:color = "red"\n'
            ' token inputs:intensity = "x"\n}\n'
            'def PointInstancer "D" {\n string protoIndices = "0"\n}\n'
            'def Cube "Good" {\n string size = "large"\n}\n'
        )
        scene = read(path)
        assert [thing.name for thing in scene.objects] == ["Good"]
        assert [light.color for light in scene.lights] == [pytest.approx((1, 1, 1))]
        path.write_text('#usda 1.0\n(\n upAxis = "W"\n)\ndef Cube "Box" {\n}\n')
        assert "upAxis is 'W'" in told(path)

    @pytest.mark.parametrize(
        ("program", "patience", "reason"),
        [
            ("import time; time.sleep(600)", 0.5, "not read it within"),
            (
                "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)",
                60.0,
                "crashes on it (SIGSEGV)",
            ),
        ],
    )
    def test_the_library_is_kept_at_a_distance(
        self,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        program: str,
        patience: float,
        reason: str,
    ) -> None:
        """A binary file that stalls or ends the library does so in another process."""
        from usarsim_maps.usd.openusd import stage

        (tmp_path / "trial.py").write_text(program)
        monkeypatch.setattr(stage, "TRIAL", tmp_path / "trial.py")
        monkeypatch.setattr(apart, "PATIENCE", patience)
        (tmp_path / "a.usdc").write_bytes(b"PXR-USDC" + bytes(100))
        assert reason in told(tmp_path / "a.usdc")
