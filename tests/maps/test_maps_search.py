"""Where the models and meshes of a Gazebo world are found, and what happens if none is."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_samples import FUZZ, WEDGE, dae, dae_wedge, read
from sdf_samples import BOX, model, sdf, shape, world, write, write_model
from t3d_maps import actor, level, start

from usarsim_maps.convert import Request, import_map
from usarsim_maps.files import AssetIndex
from usarsim_maps.findings import Findings
from usarsim_maps.gazebo.files import FolderTree
from usarsim_maps.reader import ImportOptions
from usarsim_server.base.errors import MapImportError
from usarsim_server.cli import main

MESH = dae(dae_wedge(2.0 * WEDGE))
GROUND = "<include><uri>model://ground_plane</uri></include>"


def include(uri: str, pose: str = "0 0 0 0 0 0") -> str:
    """An include."""
    return f"<include><uri>{uri}</uri><pose>{pose}</pose></include>"


def mesh(uri: str) -> str:
    """A mesh, seen and felt."""
    return shape(f"<mesh><uri>{uri}</uri></mesh>")


def collection(assets: Path, folder: str, uri: str) -> None:
    """A model `thing` with a mesh, in a folder of the assets."""
    write_model(assets / folder, "thing", sdf(model("thing", mesh(uri))))
    write(assets, MESH, f"{folder}/thing/meshes/w.dae")


@pytest.mark.parametrize(
    ("uri", "folder"),
    [
        ("file://thing", "league/2016"),
        ("thing", "league/2016"),
        ("THING", "league/2016"),
        ("file://models/thing", "x/models"),
        ("package://pkg/models/thing", "src/pkg/models"),
        ("package://pkg/models/thing/model.sdf", "src/pkg/models"),
        ("model://thing", "a/b/c/d/e/f/g"),
        ("model://models/thing", "x/models"),
        ("/home/bob/models/thing", "x/models"),
        ("file:///home/bob/models/thing/model.sdf", "x/models"),
    ],
)
def test_models(tmp_path: Path, uri: str, folder: str, findings: Findings) -> None:
    """By any kind of URI, however deep in an asset folder."""
    assets = tmp_path / "assets"
    collection(assets, folder, "model://thing/meshes/w.dae")
    source = write(tmp_path, world(GROUND + include(uri)), "map/map.world")
    scene = read(source, findings, assets=(assets,))
    assert [thing.name for thing in scene.objects] == ["thing", "ground_plane"]
    assert not findings.missing_list()
    assert assets / folder / "thing" / "model.sdf" in scene.source.files
    assert assets / folder / "thing" / "meshes" / "w.dae" in scene.source.files


@pytest.mark.parametrize(
    "uri",
    [
        "model://thing/meshes/w.dae",
        "file://thing/meshes/w.dae",
        "file://meshes/w.dae",
        "thing/meshes/w.dae",
        "meshes/w.dae",
        "w.dae",
        "package://pkg/thing/meshes/w.dae",
        "file:///home/bob/pkg/thing/meshes/w.dae",
        "C:\\maps\\thing\\meshes\\W.DAE",
    ],
)
def test_meshes(tmp_path: Path, uri: str, findings: Findings) -> None:
    """Meshes likewise, and that of the own model where others have one of the same name."""
    assets = tmp_path / "assets"
    collection(assets, "x/pkg", uri)
    write(assets, dae(dae_wedge()), "x/other/meshes/w.dae")
    source = write(tmp_path, world(include("model://thing")), "map/map.world")
    read(source, findings, assets=(assets,))
    assert not findings.missing_list()
    used = read(source, findings, assets=(assets,)).source.files
    assert assets / "x/pkg/thing/meshes/w.dae" in used
    assert assets / "x/other/meshes/w.dae" not in used


def test_another_models_mesh_will_not_do(tmp_path: Path) -> None:
    """That all models have `meshes/mesh.dae` is no reason to take that of any."""
    assets = tmp_path / "assets"
    write(assets, MESH, "chair/meshes/mesh.dae")
    for uri in ("model://table/meshes/mesh.dae", "/home/bob/table/meshes/mesh.dae", "mesh.dae"):
        findings = Findings()
        source = write(tmp_path, world(model("m", BOX + mesh(uri))), "map/map.world")
        read(source, findings, assets=(assets,))
        assert findings.missing_list() == [("mesh", uri, 2)]


def test_the_asset_folder_may_be_the_model(tmp_path: Path) -> None:
    """`--assets DIR/thing` will do for `model://thing`."""
    collection(tmp_path / "assets", ".", "model://thing/meshes/w.dae")
    source = write(tmp_path, world(include("model://thing")), "map/map.world")
    assert read(source, assets=(tmp_path / "assets" / "thing",)).objects


def test_packages_by_their_own_name(tmp_path: Path) -> None:
    """A ROS package is found by the name in its `package.xml`, whatever its folder is called."""
    assets = tmp_path / "assets"
    collection(assets, "repository/models", "package://my_models/models/thing/meshes/w.dae")
    write(assets, "<package><name> my_models </name></package>", "repository/package.xml")
    source = write(tmp_path, world(include("package://my_models/models/thing")), "map/map.world")
    assert read(source, assets=(assets,)).objects


def test_downloads_with_versions(tmp_path: Path) -> None:
    """Gazebo's downloads have a folder per version; the newest one counts."""
    assets = tmp_path / "assets"
    for version in ("2", "10"):
        text = sdf(model(f"v{version}", mesh("model://Thing/meshes/w.dae")))
        write_model(assets / "fuel.org/bob/models/Thing", version, text)
        write(assets, MESH, f"fuel.org/bob/models/Thing/{version}/meshes/w.dae")
    uri = "https://fuel.gazebosim.org/1.0/bob/models/Thing"
    source = write(tmp_path, world(include(uri)), "map/map.world")
    assert [thing.name for thing in read(source, assets=(assets,)).objects] == ["v10"]


def test_below_the_worlds_own_folder(tmp_path: Path) -> None:
    """What lies below the world may be read, so it is looked for there, too, after the assets."""
    write_model(tmp_path / "map/stuff/league", "thing", sdf(model("here", BOX)))
    source = write(tmp_path, world(include("model://thing")), "map/map.world")
    assert [thing.name for thing in read(source).objects] == ["here"]
    write_model(tmp_path / "assets/deep", "thing", sdf(model("there", BOX)))
    found = read(source, assets=(tmp_path / "assets",))
    assert [thing.name for thing in found.objects] == ["there"]


def test_a_folder_of_the_name_that_is_no_model(tmp_path: Path, findings: Findings) -> None:
    """An empty folder of the right name in the first place does not hide the model elsewhere."""
    (tmp_path / "map" / "thing").mkdir(parents=True)
    collection(tmp_path / "assets", "x", "model://thing/meshes/w.dae")
    source = write(tmp_path, world(include("model://thing")), "map/map.world")
    assert read(source, findings, assets=(tmp_path / "assets",)).objects
    assert not findings.missing_list()


LOST = GROUND + include("model://a") + include("model://b", "4 4 0 0 0 0") + include("file://c")


class TestNothingFound:
    """A map whose meshes and models are all missing is an error, not an empty plane."""

    def test_one_clear_error(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """It names what is missing, and both cures; exit code 2, and no world."""
        source = write(tmp_path, world(LOST + include("model://d")))
        assert main(["import", str(source), "--out", str(tmp_path / "out")]) == 2
        (line,) = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
        assert "none of the meshes and models that it names can be had" in line
        assert "file://c, model://a, model://b and 1 more" in line
        assert "--assets DIR" in line
        assert "--placeholders" in line
        assert not list((tmp_path / "out").glob("*"))

    def test_placeholders(self, tmp_path: Path) -> None:
        """On request a box stands in for each."""
        source = write(tmp_path, world(LOST))
        report = import_map(Request(source, options=ImportOptions(placeholders=True))).report
        assert report.totals["objects"] == 4
        assert report.extents == pytest.approx((4.5, 4.5, 0.5))
        assert len(report.missing) == 3

    def test_meshes_that_cannot_be_read(self, tmp_path: Path) -> None:
        """The first reason is told."""
        write(tmp_path, "no mesh", "a.dae")
        source = write(tmp_path, world(GROUND + model("m", mesh("a.dae"))))
        with pytest.raises(MapImportError, match=r"can be had: a\.dae; a\.dae: .*XML"):
            import_map(Request(source))

    def test_unreal(self, tmp_path: Path) -> None:
        """A level of static meshes that are all missing; one with walls of its own can be used."""
        lone = actor("StaticMeshActor", "M", (0, 0, 0), "StaticMesh=StaticMesh'Pkg.Chair'")
        source = write(tmp_path, level(lone, start("S", (0, 0, 60))), "map.t3d")
        with pytest.raises(MapImportError, match=r"can be had: Pkg\.Chair \("):
            import_map(Request(source))

    def test_people_on_a_plane_are_a_map(self, tmp_path: Path) -> None:
        """Figures of people need no files, so a plane with some of them is a whole map."""
        source = write(tmp_path, world(GROUND + include("model://person_standing")))
        report = import_map(Request(source)).report
        assert report.totals["victims"] == 1
        assert report.missing == (("person", "model://person_standing", 1),)


NAMES = st.sampled_from(["a", "b", "meshes", "1", "w.dae", "model.sdf"])


@settings(FUZZ, max_examples=60)
@given(st.lists(st.lists(NAMES, min_size=1, max_size=4), max_size=6), st.lists(NAMES, min_size=1))
def test_any_tree(tmp_path: Path, paths: list[list[str]], wanted: list[str]) -> None:
    """What is found ends as it should, and what lies exactly there is found."""
    root = tmp_path / str(abs(hash(str(paths))))
    for parts in paths:
        folder = root.joinpath(*parts[:-1])
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / parts[-1]).touch()
        except OSError:  # a file where a folder should be
            continue
    tree, asker = FolderTree((root,)), root / "map.world"
    found = tree.find(wanted, asker, Path.is_file, exact=True)
    assert (root.joinpath(*wanted)).is_file() <= (found is not None)
    if found is not None:
        assert found.name == wanted[-1]
        assert [p for p in found.parts if p != "1"][-len([w for w in wanted if w != "1"]):] == [
            w for w in wanted if w != "1"
        ]  # fmt: skip
    tree.find(wanted, asker, Path.exists, exact=False)


def test_pictures_and_meshes_of_other_formats_are_found_deep_down(tmp_path: Path) -> None:
    """All readers look everywhere in the asset folders (`AssetIndex`)."""
    write(tmp_path, "x", "a/b/c/d/e/f/g/h/Wall.png")
    assert AssetIndex([tmp_path]).find("Pkg.Wall.png") is None
    assert AssetIndex([tmp_path]).find("file://textures/wall.PNG") is not None
