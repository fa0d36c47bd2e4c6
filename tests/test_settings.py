"""Settings: defaults, precedence, paths, and what follows from them."""

from __future__ import annotations

import argparse
import math
from dataclasses import FrozenInstanceError, fields
from pathlib import Path

import pytest

from usarsim_server.base.errors import SettingsError
from usarsim_server.cli import build_parser
from usarsim_server.cli.serve import settings_from
from usarsim_server.options import OPTIONS, load_settings
from usarsim_server.protocol.dialects import DialectMode
from usarsim_server.protocol.images import NORMAL, ImageType
from usarsim_server.settings import Settings

PORT_KEYS = [
    "port",
    "image_port",
    "groundtruth_port",
    "wireless_port",
    "truth_port",
    "comserver_port",
]

GOOD = [
    # key, command line, TOML, value
    ("world", "yard", '"yard"', "yard"),
    ("world", "7", '"7"', "7"),
    ("host", "0.0.0.0", '"0.0.0.0"', "0.0.0.0"),
    *((key, "4321", "4321", 4321) for key in PORT_KEYS),
    *((key, "0", "0", 0) for key in PORT_KEYS),
    *((key, "65535", "65535", 65535) for key in PORT_KEYS),
    *((key, "off", '"off"', None) for key in PORT_KEYS),
    *(("image_type", f"{number}", f"{number}", ImageType(number)) for number in (0, 5, 6, 300)),
    *(
        ("image_type", name, f'"{name}"', ImageType(number))
        for name, number in [("RAW", 0), ("super", 1), ("Good", 2), ("fair", 4), ("BAD", 5)]
    ),
    ("image_type", "", '""', NORMAL),
    ("image_legacy", "true", "true", True),
    ("image_legacy", "false", "false", False),
    ("image_silent_push", "off", '"off"', 0.0),
    ("image_silent_push", "0.5", "0.5", 0.5),
    ("tiles", "1x1", '"1x1"', (1, 1)),
    ("tiles", "8X8", '"8 x 8"', (8, 8)),
    ("spectator", "0,0,-5,3,0,0", '"0,0,-5,3,0,0"', ("0,0,-5,3,0,0",)),
    ("renderer", "rays", '"rays"', "rays"),
    ("camera_rate", "7.5", "7.5", 7.5),
    ("shadows", "1024", "1024", 1024),
    ("multisample", "4", "4", 4),
    ("tile_size", "176x144", '"176x144"', (176, 144)),
    ("tile_size", "16x2048", '"16x2048"', (16, 2048)),
    ("dialect", "auto", '"auto"', DialectMode.AUTO),
    ("dialect", "ut2004", '"ut2004"', DialectMode.UT2004),
    ("dialect", "udk", '"udk"', DialectMode.UDK),
    ("speed", "2", "2", 2.0),
    ("speed", "0.5", "0.5", 0.5),
    ("speed", "max", '"max"', math.inf),
    ("seed", "42", "42", 42),
    ("seed", "0", "0", 0),
    ("timestep", "0.002", "0.002", 0.002),
    ("max_robots", "1", "1", 1),
    ("max_robots", "256", "256", 256),
    ("max_objects", "0", "0", 0),
    ("max_objects", "4096", "4096", 4096),
    ("allow_outside", "true", "true", True),
    ("log_level", "debug", '"debug"', "debug"),
    ("log_level", "error", '"error"', "error"),
]

FILE_ONLY_GOOD = [
    ("sta_order", '"udk"', "udk"),
    ("max_connections", "1", 1),
    ("max_connections", "1024", 1024),
    ("default_start", '"first"', "first"),
    ("second_init", '"replace"', "replace"),
    ("clean_on_close", "false", False),
    ("max_per_address", "8", 8),
    ("max_per_address", '"off"', None),
    ("connection_rate", "5", 5.0),
    ("connection_rate", '"off"', math.inf),
    ("line_bytes", "65536", 65536),
    ("line_bytes", "1000000", 1000000),
    ("command_rate", "200", 200.0),
    ("command_rate", '"off"', math.inf),
    ("spawn_rate", "0.5", 0.5),
    ("spawn_rate", '"off"', math.inf),
    ("idle_timeout", "10", 10.0),
    ("idle_timeout", '"off"', 0.0),
    ("reply_bytes", "65536", 65536),
    ("outbox_bytes", "65536", 65536),
    ("quiet_period", "0", 0.0),
    ("quiet_period", "0.3", 0.3),
]


def written(folder: Path, text: str) -> Path:
    """A settings file with this text."""
    path = folder / "lab.toml"
    path.write_text(text, encoding="utf-8")
    return path


def served(*arguments: str) -> Settings:
    """Settings of `usarsim serve` with these arguments."""
    parsed: argparse.Namespace = build_parser().parse_args(["serve", *arguments])
    return settings_from(parsed)


def flag(key: str) -> str:
    """The command line option of a key."""
    return "--" + key.replace("_", "-")


# Values


def test_defaults_are_those_of_the_legacy_installations() -> None:
    """Without options: the documented ports, this machine only, real time, the arena."""
    assert served() == Settings()
    assert Settings() == Settings(
        world="arena",
        host="127.0.0.1",
        port=3000,
        image_port=5003,
        groundtruth_port=7435,
        wireless_port=50000,
        truth_port=3989,
        comserver_port=None,
        image_type=NORMAL,
        image_legacy=False,
        image_silent_push=2.0,
        tiles=(4, 4),
        tile_size=(320, 240),
        dialect=DialectMode.AUTO,
        speed=1.0,
        seed=0,
        timestep=0.004,
        config=None,
        robots=(),
        max_robots=16,
        max_objects=256,
        clean_on_close=True,
        log_level="warning",
        sta_order="ut2004",
        max_connections=64,
        default_start="origin",
        second_init="ignore",
        max_per_address=None,
        connection_rate=100.0,
        line_bytes=65536,
        command_rate=1000.0,
        spawn_rate=20.0,
        idle_timeout=300.0,
        outbox_bytes=262144,
        reply_bytes=1048576,
        quiet_period=0.27,
    )


def test_every_setting_has_exactly_one_option() -> None:
    """Nothing in `Settings` is out of reach, and the table names nothing else."""
    keys = [option.key for option in OPTIONS]
    assert sorted([*keys, "config", "written"]) == sorted(field.name for field in fields(Settings))


def test_settings_cannot_be_changed() -> None:
    """Settings are shared by threads and therefore frozen."""
    with pytest.raises(FrozenInstanceError):
        Settings().port = 1  # type: ignore[misc]


@pytest.mark.parametrize(("key", "text", "toml", "value"), GOOD)
def test_value_means_the_same_on_the_command_line_and_in_the_file(
    tmp_path: Path, key: str, text: str, toml: str, value: object
) -> None:
    """Every option can stand in either place, with the same result of the same type."""
    from_line = getattr(served(f"{flag(key)}={text}"), key)
    from_file = getattr(load_settings({}, written(tmp_path, f"{key} = {toml}\n")), key)
    assert from_line == from_file == value
    assert type(from_line) is type(from_file) is type(value)


@pytest.mark.parametrize(("key", "toml", "value"), FILE_ONLY_GOOD)
def test_file_sets_what_the_command_line_cannot(
    tmp_path: Path, key: str, toml: str, value: object
) -> None:
    """Rare settings stand in the file only; the command line does not know them."""
    assert getattr(load_settings({}, written(tmp_path, f"{key} = {toml}\n")), key) == value
    with pytest.raises(SystemExit):
        served(flag(key), "1")


@pytest.mark.parametrize(("key", "text", "toml", "value"), GOOD)
def test_command_line_wins_over_the_file(
    tmp_path: Path, key: str, text: str, toml: str, value: object
) -> None:
    """A value on the command line replaces that of the file and leaves the other keys alone."""
    others = {"world": '"hall"', "speed": "3", "seed": "5", "max_robots": "7", "truth_port": "99"}
    file = {**others, "host": '"10.0.0.1"', "log_level": '"info"'}
    file |= {"port": "98", "image_port": "97", "timestep": "0.01"}
    file |= {"groundtruth_port": "96", "wireless_port": "95", "comserver_port": "94"}
    file |= {"image_type": '"FAIR"' if text != "fair" else "7", "image_silent_push": "9"}
    file["image_legacy"] = "false" if text == "true" else "true"
    file["dialect"] = '"ut2004"' if text == "udk" else '"udk"'
    path = written(tmp_path, "".join(f"{name} = {toml}\n" for name, toml in file.items()))
    from_file = load_settings({}, path)
    both = served("--config", str(path), f"{flag(key)}={text}")
    assert getattr(both, key) == value != getattr(from_file, key)
    unchanged = {field.name for field in fields(Settings)} - {key, "written"}
    assert all(getattr(both, name) == getattr(from_file, name) for name in unchanged)
    assert both.config == path


def test_settings_know_which_of_them_were_asked_for(tmp_path: Path) -> None:
    """A port that somebody wrote down is demanded, even if it is the default; others are not."""
    path = written(tmp_path, "image-port = 5003\n")
    settings = served("--config", str(path), "--truth-port=3989")
    assert settings.demands("image_port")
    assert settings.demands("truth_port")
    assert not settings.demands("groundtruth_port")
    assert not Settings().demands("port")


def test_hyphens_of_the_command_line_are_understood_in_the_file(tmp_path: Path) -> None:
    """`image-port` is what the help says, so the file takes it too."""
    assert load_settings({}, written(tmp_path, "image-port = 1\n")).image_port == 1


@pytest.mark.parametrize("option", [one for one in OPTIONS if one.switch])
def test_switch_alone_means_true(option) -> None:
    """A switch needs no value on the command line; with one it can overrule the file."""
    assert getattr(served(option.flag), option.key) is True
    assert getattr(served(option.flag, "--seed=1"), option.key) is True
    assert getattr(served(option.flag, "false"), option.key) is False


def test_picture_that_nobody_could_render_is_refused(tmp_path: Path) -> None:
    """Tiles and their size may each be fine and together too much; both places are tried."""
    with pytest.raises(SettingsError, match=r"--tile-size: the full picture would be 1\d+x240 "):
        served("--tiles=16x1", "--tile-size=1024x240")
    path = written(tmp_path, 'tile_size = "640x2048"\n')
    with pytest.raises(SettingsError, match=r"tile_size: the full picture would be 2560x10240"):
        served("--config", str(path), "--tiles=4x5")
    with pytest.raises(SettingsError, match="--tiles: the full picture would be 20480x240"):
        served("--tiles=64x1")


# Paths


def test_robot_folders_may_be_repeated(tmp_path: Path) -> None:
    """`--robots` adds a folder each time it is given, in order."""
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    found = served("--robots", str(tmp_path / "b"), "--robots", str(tmp_path / "a")).robots
    assert found == (tmp_path / "b", tmp_path / "a")


@pytest.mark.parametrize("toml", ['"mine"', '["mine"]'])
def test_folders_of_the_file_are_seen_from_the_file(tmp_path: Path, toml: str) -> None:
    """A relative folder in the file starts from the file's own folder, not from the shell's."""
    (tmp_path / "mine").mkdir()
    path = written(tmp_path, f"robots = {toml}\n")
    assert load_settings({}, path).robots == (tmp_path / "mine",)


def test_folders_of_the_command_line_are_seen_from_the_shell(tmp_path: Path, monkeypatch) -> None:
    """A relative folder on the command line starts from the working directory."""
    (tmp_path / "mine").mkdir()
    monkeypatch.chdir(tmp_path)
    assert served("--robots", "mine").robots[0].samefile(tmp_path / "mine")


def test_missing_robot_folder_is_refused(tmp_path: Path) -> None:
    """A folder that does not exist is named with the option."""
    with pytest.raises(SettingsError, match=r"--robots: there is no folder .*nowhere"):
        served("--robots", str(tmp_path / "nowhere"))


def test_world_with_a_slash_is_a_path(tmp_path: Path, monkeypatch) -> None:
    """A path in the file starts from the file, one on the command line from the shell."""
    path = written(tmp_path, 'world = "./halls/b2"\n')
    assert load_settings({}, path).world == str(tmp_path / "halls/b2")
    monkeypatch.chdir(tmp_path)
    assert Path(served("--world", "./halls/b2").world) == Path.cwd() / "halls/b2"
    assert served("--world", "b2").world == "b2"


def test_tilde_is_the_home_folder(tmp_path: Path, monkeypatch) -> None:
    """In the file, where no shell expands it, `~` is the user's home."""
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "mine").mkdir()
    path = written(tmp_path, 'robots = "~/mine"\nworld = "~/hall"\n')
    assert load_settings({}, path).robots == (tmp_path / "mine",)
    assert load_settings({}, path).world == str(tmp_path / "hall")


def test_robots_have_room_for_their_connections(tmp_path: Path) -> None:
    """More robots than the default number of connections can connect, unless the file forbids."""
    assert served().connections == 64
    assert served("--max-robots=128").connections > 128
    file = written(tmp_path, "max_connections = 70\nmax_robots = 128\n")
    assert load_settings({}, file).connections == 70


@pytest.mark.parametrize(
    ("speed", "commands", "robots"), [(0.5, 1000.0, 20.0), (3.0, 3000.0, 60.0)]
)
def test_rates_of_clients_follow_the_speed_of_the_world(
    speed: float, commands: float, robots: float
) -> None:
    """A world that runs three times as fast is told three times as much; a slow one not less."""
    settings = Settings(speed=speed)
    assert (settings.input_rate, settings.robot_rate) == (commands, robots)


def test_rates_of_clients_are_off_in_lockstep() -> None:
    """At `--speed max` wall time must not decide what is obeyed."""
    settings = Settings(speed=math.inf)
    assert settings.input_rate == settings.robot_rate == math.inf
