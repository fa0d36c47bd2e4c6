"""Finding worlds by name or path, and where shipped data lies."""

from __future__ import annotations

from pathlib import Path

import pytest
from world_files import write_world

from usarsim_server import data
from usarsim_server.errors import WorldError
from usarsim_server.worlds.loader import DEFAULT_WORLD, find_world, list_worlds

SHIPPED = {"arena", "empty", "office", "plant", "proving_ground", "smoke_corridor"}


def test_the_shipped_worlds_are_listed() -> None:
    """The list holds at least the shipped worlds, sorted, each with a title."""
    worlds = list_worlds()
    names = [world.name for world in worlds]
    assert set(names) >= SHIPPED
    assert names == sorted(names)
    assert all(world.title and world.description for world in worlds)


def test_the_default_world_is_the_arena() -> None:
    """The world of a server that was told nothing exists and is the arena."""
    assert DEFAULT_WORLD == "arena"
    assert find_world(DEFAULT_WORLD).name == "arena"


@pytest.mark.parametrize("name", ["office", "Office", "OFFICE"])
def test_a_name_is_found_in_any_case(name: str) -> None:
    """Capitals make no difference in a world's name."""
    assert find_world(name) == data.data_directory("worlds") / "office"


def test_a_folder_is_found_by_its_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A path is taken as it is, absolute or relative."""
    folder = write_world(tmp_path)
    assert find_world(str(folder)) == folder
    monkeypatch.chdir(tmp_path)
    assert find_world("yard") == Path("yard")
    assert find_world("./yard") == Path("./yard")


def test_extra_folders_come_before_the_shipped_ones(tmp_path: Path) -> None:
    """A user's world hides a shipped one of the same name, for finding and for listing."""
    mine = write_world(tmp_path, name="office")
    assert find_world("office", [tmp_path]) == mine
    listed = {world.name: world for world in list_worlds([tmp_path])}
    assert listed["office"].folder == mine
    assert set(listed) >= SHIPPED


def test_the_first_extra_folder_wins(tmp_path: Path) -> None:
    """Extra folders are searched in their order."""
    first = write_world(tmp_path / "one")
    write_world(tmp_path / "two")
    assert find_world("yard", [tmp_path / "one", tmp_path / "two"]) == first


def test_an_unknown_name_lists_the_known_ones(tmp_path: Path) -> None:
    """The error suggests the nearest name and lists all, the extra ones too."""
    write_world(tmp_path)
    with pytest.raises(WorldError) as caught:
        find_world("ofice", [tmp_path])
    text = str(caught.value)
    assert text.startswith("ofice: no such world (cure: did you mean office?")
    assert all(name in text for name in (*SHIPPED, "yard"))


def test_a_path_without_world_says_what_is_missing(tmp_path: Path) -> None:
    """A path that is no world folder is not looked up as a name."""
    with pytest.raises(WorldError, match=r"not a world folder .*world\.toml"):
        find_world(str(tmp_path / "arena"))


def test_folders_without_a_sheet_are_no_worlds(tmp_path: Path) -> None:
    """Stray files and folders beside the worlds are ignored."""
    (tmp_path / "notes").mkdir()
    (tmp_path / "readme.txt").write_text("x", encoding="utf-8")
    assert [world.name for world in list_worlds([tmp_path, tmp_path / "nowhere"])] == sorted(
        world.name for world in list_worlds()
    )


def test_an_installed_package_carries_its_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Data inside the package is preferred; without it the folder beside the package is used."""
    package = tmp_path / "usarsim_server"
    package.mkdir()
    monkeypatch.setattr(data, "_PACKAGE", package)
    assert data.data_directory("worlds") == tmp_path / "worlds"
    (package / "_data" / "worlds").mkdir(parents=True)
    assert data.data_directory("worlds") == package / "_data" / "worlds"
    assert data.data_directory("robots") == tmp_path / "robots"
