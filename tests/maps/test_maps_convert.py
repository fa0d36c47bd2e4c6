"""Whole imports: cache, sidecar, report, pictures, the command (worlds reference 13)."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import pytest
from PIL import Image
from t3d_maps import actor, brush, level, room, start, two_rooms

from usarsim_maps import cache as cache_module
from usarsim_maps.build.preview import Preview
from usarsim_maps.cache import DOOR
from usarsim_maps.convert import Imported, Request, import_map
from usarsim_maps.files import AssetIndex
from usarsim_maps.reader import ImportOptions, find_reader, readers
from usarsim_server.base.errors import MapImportError
from usarsim_server.cli import main
from usarsim_server.testing import Rehearsal
from usarsim_server.worlds.loader import load_world


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A map of two rooms."""
    path = tmp_path / "two.t3d"
    path.write_text(two_rooms())
    return path


def imported(source: Path, **more: object) -> Imported:
    """Import with the test's own cache."""
    return import_map(Request(source, **more))  # type: ignore[arg-type]


class TestCache:
    """What was imported once is there."""

    def test_a_second_import_does_nothing(self, source: Path) -> None:
        """The same world comes from the cache, with its report (worlds 67)."""
        first = imported(source)
        second = imported(source)
        assert not first.cached
        assert second.cached
        assert second.folder == first.folder
        assert second.report.text() == first.report.text()

    def test_the_second_import_is_quick(self, tmp_path: Path) -> None:
        """A remembered level of 200 rooms takes a fifth of the work or less (worlds 67).

        Counted in processor time of this process, which other programs do not disturb.
        """
        corners = [(800 * x, 800 * y) for x in range(14) for y in range(14)]
        rooms = [
            brush(f"R{x}_{y}", (x, y, 0), (x + 750, y + 750, 700), "CSG_Subtract")
            for x, y in corners
        ]
        path = tmp_path / "many.t3d"
        path.write_text(level(*rooms, start("S", (300, 300, 60))))
        times = []
        for _ in range(2):
            began = time.process_time()
            imported(path)
            times.append(time.process_time() - began)
        assert times[1] < times[0] / 5.0

    @pytest.mark.parametrize("change", ["map", "option", "sidecar", "asset", "name"])
    def test_any_change_is_noticed(self, source: Path, tmp_path: Path, change: str) -> None:
        """Editing the map, an option, the sidecar or an asset imports again (worlds 68)."""
        assets = tmp_path / "assets"
        assets.mkdir()
        options = ImportOptions(assets=(assets,))
        imported(source, options=options)
        assert imported(source, options=options).cached
        name = None
        match change:
            case "map":
                source.write_text(two_rooms().replace("Entry", "Front"))
            case "option":
                options = ImportOptions(assets=(assets,), scale=200.0)
            case "sidecar":
                (tmp_path / "two.usarsim.toml").write_text('title = "Two"\n')
            case "asset":
                (assets / "Wall.png").write_bytes(b"x")
            case "name":
                name = "other"
        assert not imported(source, options=options, name=name).cached

    def test_files_beside_the_map_are_watched(self, tmp_path: Path) -> None:
        """A picture that the map uses and that changes makes the entry stale (worlds 68)."""
        Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / "Wall.png")
        path = tmp_path / "map.t3d"
        path.write_text(level(room(), start("S", (0, 0, 60))))
        assert not imported(path).cached
        assert imported(path).cached
        Image.new("RGB", (8, 8), (0, 0, 255)).save(tmp_path / "Wall.png")
        assert not imported(path).cached

    def test_damaged_entries_are_made_again(self, source: Path) -> None:
        """A record that somebody has broken counts as none."""
        first = imported(source)
        record = first.folder / cache_module.RECORD
        for text in ("", "{}", '{"files": {}, "report": {"extents": 1}}', "[1]"):
            record.write_text(text)
            again = imported(source)
            assert not again.cached
            assert load_world(again.folder).starts

    def test_old_entries_go(self, source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """The cache keeps a bounded number of worlds."""
        monkeypatch.setattr(cache_module, "KEPT", 2)
        folders = [imported(source, name=f"w{n}").folder for n in range(4)]
        assert [folder.is_dir() for folder in folders] == [False, False, True, True]

    def test_entries_in_use_stay(self, source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """What a server runs in is neither removed nor replaced; later imports find the newer."""
        monkeypatch.setattr(cache_module, "KEPT", 1)
        held = imported(source, hold=True).folder
        text = (held / "world.toml").read_bytes()
        stamp = (held / "scene.xml").stat().st_mtime_ns
        others = [imported(source, name=f"w{n}").folder for n in range(3)]
        assert [folder.is_dir() for folder in others] == [False, False, True]
        newer = imported(source, fresh=True).folder
        assert newer != held
        assert (held / "world.toml").read_bytes() == text
        assert (held / "scene.xml").stat().st_mtime_ns == stamp
        again = imported(source)
        assert again.cached
        assert again.folder == newer

    def test_robots_come_after_the_map_has_changed(self, source: Path) -> None:
        """A server's world stays what it was; a robot of a new class still finds room in it."""
        with Rehearsal(world=str(source)) as rehearsal:
            source.write_text(two_rooms().replace("Entry", "Front"))
            imported(source, fresh=True)
            client = rehearsal.connect()
            client.send("INIT {ClassName USARBot.P2AT} {Start Entry}")
            rehearsal.run(0.5)
            assert client.take("STA")

    def test_a_cache_that_cannot_be_written(self, source: Path, tmp_path: Path) -> None:
        """One clear error names the cure."""
        (tmp_path / "file").write_text("")
        with pytest.raises(MapImportError, match="XDG_CACHE_HOME"):
            imported(source, cache=tmp_path / "file" / "cache")

    def test_a_failed_import_leaves_nothing(self, source: Path, own_cache: Path) -> None:
        """After an error there is no half world anywhere."""
        source.write_text(level(brush("B", (0, 0, 0), (1, 1, 1))))
        with pytest.raises(MapImportError, match="absurd"):
            imported(source)
        assert not [p for p in own_cache.rglob("*") if p.is_file() and p.name != DOOR]


class TestTarget:
    """Where the world goes."""

    def test_imported_worlds_are_replaced_and_others_are_not(
        self, source: Path, tmp_path: Path
    ) -> None:
        """A folder that no import made is left alone (exit code 2)."""
        out = tmp_path / "out"
        first = imported(source, out=out)
        assert first.folder == out / "two"
        (first.folder / "stray").write_text("x")
        assert not (imported(source, out=out).folder / "stray").exists()
        (out / "mine").mkdir()
        (out / "mine" / "thesis.tex").write_text("x")
        with pytest.raises(MapImportError, match="something here already"):
            imported(source, out=out, name="mine")
        assert (out / "mine" / "thesis.tex").exists()

    def test_the_folder_is_complete(self, source: Path, tmp_path: Path) -> None:
        """The copied world loads when the map and the cache are gone (worlds 70)."""
        folder = imported(source, out=tmp_path / "out", cache=tmp_path / "c").folder
        source.unlink()
        world = load_world(folder)
        assert [one.tag for one in world.starts] == ["Entry", "PlayerStart_1"]
        Preview(world)


class TestSidecar:
    """What the map does not say."""

    SIDECAR = """
title = "House"
scale = 125
replace = ["starts"]

[[start]]
tag = "Hall"
position = [1.0, 2.0, 0.3]
yaw_degrees = 90.0

[[victim]]
name = "FemaleVictim_9"
position = [-1.0, 0.0, 0.3]
figure = "female"
posture = "lying"

[[path_node]]
tag = "P"
position = [0.0, 0.0, 0.0]

[[smoke]]
name = "fog"
kind = "global"
density = 0.2

[[light]]
name = "Lamp"
position = [0.0, 0.0, 2.0]

[[object]]
match = "Door*"
exclude = true

[material."Pkg.Wall"]
color = [1.0, 0.0, 0.0]
"""

    def test_everything_can_be_said(self, source: Path, tmp_path: Path) -> None:
        """Scale, starts, victims and exclusions are overridden and reported (worlds 74)."""
        sidecar = tmp_path / "extra.toml"
        sidecar.write_text(self.SIDECAR)
        result = imported(source, sidecar=sidecar)
        world = load_world(result.folder)
        assert world.title == "House"
        assert [one.tag for one in world.starts] == ["Hall"]
        assert world.starts[0].pose.rotate((1, 0, 0)) == pytest.approx((0, 1, 0))
        assert world.victims[0].name == "FemaleVictim_9"
        assert world.path_nodes[0].tag == "P"
        assert world.smoke.haze == 0.2
        assert result.report.source["units_per_metre"] == 125.0
        assert result.report.extents[0] == pytest.approx(2050 / 125, abs=0.1)
        told = " ".join(text for _, text, _ in result.report.warnings)
        assert "replaces the starts: 1 new" in told
        assert "adds to the victims: 1 new" in told
        assert "'Door*' of the sidecar applies to 1 things" in told
        preview = Preview(world)
        assert preview.lower[0] < 0.0

    def test_objects_can_be_changed(self, tmp_path: Path) -> None:
        """Rules by name, tag or class hide, fix, loosen and weigh things (worlds 74)."""
        path = tmp_path / "map.t3d"
        mesh = "Begin Object Class=C Name=C\nStaticMesh=StaticMesh'P.M'\nEnd Object"
        path.write_text(
            level(
                room(),
                *(actor("StaticMeshActor", f"M{n}", (n * 100, 0, 60), mesh) for n in range(3)),
            )
        )
        (tmp_path / "map.usarsim.toml").write_text(
            "placeholders = true\n"
            '[[object]]\nmatch = "M0"\nmovable = true\nmass = 7.0\n'
            '[[object]]\nmatch = "M1"\nexclude = true\n'
            '[[object]]\nmatch = "M2"\ncollision = "none"\n'
        )
        world = load_world(imported(path).folder)
        kinds = {one.original: one.movable for one in world.objects}
        assert kinds == {"M0": True, "M2": False, "Room": False}

    @pytest.mark.parametrize(
        ("text", "told"),
        [
            ("scale = true", "scale"),
            ('up = "W"', "write one of X, Y, Z"),
            ("sale = 3", "did you mean scale"),
            ('replace = ["walls"]', "'walls' is unknown"),
            ('[[object]]\nmatch = "a"\ncollision = "soft"', "write one of auto"),
            ("assets = 3", "not a list of texts"),
            ("[[start]]\ntag = 3", "tag"),
            ("x = [", "not valid TOML"),
            ("x = " + "[" * 5000, "not valid TOML"),
            ("x = " + "9" * 5000, "not valid TOML"),
            ("[material]\na = 3", "table"),
        ],
    )
    def test_mistakes_are_named(self, source: Path, tmp_path: Path, text: str, told: str) -> None:
        """File, key and cure are named; the map is not even opened."""
        sidecar = tmp_path / "bad.toml"
        sidecar.write_text(text)
        with pytest.raises(MapImportError, match=f"bad.toml.*{told}"):
            imported(source, sidecar=sidecar)


class TestReport:
    """What users are told."""

    def test_it_holds_what_matters(self, source: Path) -> None:
        """Scale, extents, counts, heights of starts, missing files and advice on copying."""
        report = imported(source).report
        text = report.text()
        for part in ("250 units per metre", "8.20 x 4.00 x 2.50 m", "3 Brush", "Entry", "0.24 m"):
            assert part in text, text
        assert "texture Pkg.Wall" in text
        assert "ask its author" in text
        assert json.loads(json.dumps(report.data()))["starts"][0][0] == "Entry"

    def test_a_licence_beside_the_map_is_quoted(self, source: Path, tmp_path: Path) -> None:
        """The report says what the author allows."""
        (tmp_path / "LICENSE.txt").write_text("\nDo what you like License\n")
        assert "Do what you like" in imported(source).report.licence

    def test_transparent_materials_are_named(self, tmp_path: Path) -> None:
        """Lasers pass glass; whoever imports a map wants to know where."""
        path = tmp_path / "map.t3d"
        path.write_text(
            level(room(), start("S", (0, 0, 60))).replace("Pkg.Wall", "Pkg.Window_Glass")
        )
        assert imported(path).report.transparent == ("Pkg.Window_Glass",)


class TestCommand:
    """`usarsim import`."""

    def test_a_whole_run(
        self, source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """The world, the report file and the pictures are written; the exit code is 0."""
        out = str(tmp_path / "out")
        report = tmp_path / "report.json"
        options = ["--out", out, "--name", "house", "--report", str(report), "--preview"]
        assert main(["import", str(source), *options]) == 0
        printed = capsys.readouterr()
        assert "250 units per metre" in printed.out
        assert printed.err == ""
        assert load_world(tmp_path / "out" / "house").name == "house"
        assert json.loads(report.read_text())["totals"]["starts"] == 2
        assert (tmp_path / "out" / "house" / "preview" / "top.png").is_file()

    @pytest.mark.parametrize(
        ("arguments", "told"),
        [
            (["nowhere.t3d"], "no such file"),
            (["two.t3d", "--scale", "0"], "--scale"),
            (["two.t3d", "--scale", "big"], "no scale"),
            (["two.t3d", "--scale", "nan"], "no scale"),
            (["two.t3d", "--assets", "nowhere"], "no such folder"),
            (["two.t3d", "--sidecar", "nowhere.toml"], "nowhere.toml"),
            (["two.t3d", "--scale", "0.001"], "absurd"),
            (["two.xyz"], "unknown kind of map"),
            (["."], "it is a folder"),
            (["two.t3d", "--report", "nowhere/r.txt"], "cannot be written"),
        ],
    )
    def test_bad_input(
        self,
        source: Path,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
        arguments: list[str],
        told: str,
    ) -> None:
        """One line on standard error with the cure, exit code 2, no traceback (worlds 72, 73)."""
        monkeypatch.chdir(tmp_path)
        (tmp_path / "two.xyz").write_bytes(b"\0\1\2\3 nothing that anybody knows")
        assert main(["import", *arguments, "--out", "out"]) == 2
        error = capsys.readouterr().err
        assert error.startswith("error: ")
        assert told in error
        assert error.count("\n") == 1


class TestFinding:
    """Readers by file, assets by name."""

    def test_readers_are_found(self, tmp_path: Path) -> None:
        """By extension, or by the first bytes where there is none that is known."""
        assert {"t3d", "ase"} <= set(readers())
        (tmp_path / "map.txt").write_text("\n  Begin Map\nEnd Map\n")
        assert find_reader(tmp_path / "map.txt").title == "Unreal T3D"

    @pytest.mark.parametrize(
        "name",
        [
            "Wall.png",
            "wall.PNG",
            "C:\\art\\old\\Wall.tga",
            "file:///home/me/Wall%2Epng",
            "model://house/materials/textures/Wall.png",
            '"Wall"',
            "../../Wall.png",
        ],
    )
    def test_assets_are_found_however_they_are_named(self, tmp_path: Path, name: str) -> None:
        """Capitals, lost folders, other systems' paths and extensions do not matter."""
        path = tmp_path / "house" / "materials" / "Wall.png"
        path.parent.mkdir(parents=True)
        path.write_bytes(b"")
        (tmp_path / "other").mkdir()
        (tmp_path / "other" / "Wall.png").write_bytes(b"")
        found = AssetIndex([tmp_path]).find(name, (".png",))
        assert found is not None
        assert found.name == "Wall.png"
        if "house" in name:
            assert found == path

    def test_only_usual_folders_beside_a_map_are_searched(self, tmp_path: Path) -> None:
        """A map in a home folder does not make us read the whole home."""
        for folder in ("textures", "private"):
            (tmp_path / folder).mkdir()
            (tmp_path / folder / f"{folder}.png").write_bytes(b"")
        index = AssetIndex([], tmp_path / "map.t3d")
        assert index.find("textures.png") is not None
        assert index.find("private.png") is None
        assert index.find("") is None

    def test_names_do_not_lead_out_of_the_folder(self, tmp_path: Path) -> None:
        """`..` and absolute paths in a map never reach files elsewhere."""
        (tmp_path / "secret.png").write_bytes(b"")
        (tmp_path / "assets").mkdir()
        index = AssetIndex([tmp_path / "assets"])
        assert index.find("../secret.png") is None
        assert index.find(os.fspath(tmp_path / "secret.png")) is None
