"""Settings: defaults, precedence, and an error with place and cure for everything wrong."""

from __future__ import annotations

import argparse
import math
from dataclasses import FrozenInstanceError, fields
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from usarsim_server.cli import build_parser
from usarsim_server.cli.serve import settings_from
from usarsim_server.errors import SettingsError
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

BAD = [
    ("world", "", '""'),
    ("host", "", '""'),
    ("host", "a\tb", '"a\\tb"'),
    ("image_type", "JPEG", '"JPEG"'),
    ("image_type", "-1", "-1"),
    ("image_type", "true", "true"),
    ("image_legacy", "yes", '"yes"'),
    ("image_silent_push", "never", '"never"'),
    ("tiles", "0x4", '"0x4"'),
    ("tiles", "13x5", '"13x5"'),
    ("tiles", "4", '"4"'),
    ("tiles", "-4x-4", '"-4x-4"'),
    ("renderer", "opengl", '"opengl"'),
    ("spectator", " ", '[" "]'),
    ("multisample", "3", "3"),
    ("multisample", "true", "true"),
    ("tile_size", "15x240", '"15x240"'),
    ("tile_size", "320x2049", '"320x2049"'),
    ("tile_size", "320*240", '"320*240"'),
    ("tile_size", "99999x99999", '"99999x99999"'),
    ("dialect", "UDK", '"UDK"'),
    ("speed", "inf", "inf"),
    ("port", "1.5", "1.5"),
    ("log_level", "loud", '"loud"'),
]

NUMBERS = [option for option in OPTIONS if math.isfinite(option.declared.limits.low)]

ILL_TYPED = [
    ("world", "3"),
    ("host", "3"),
    ("port", '"3000"'),
    ("port", "3000.0"),
    ("dialect", "1"),
    ("robots", "1"),
    ("robots", "[1]"),
    ("robots", '[""]'),
    ("sta_order", '"utd"'),
    ("default_start", '"last"'),
    ("second_init", "true"),
    ("clean_on_close", '"true"'),
    ("clean_on_close", "1"),
    ("image_type", "3.0"),
    ("tiles", "[4, 4]"),
    ("tile_size", "true"),
    ("image_type", '"3"'),
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


# Errors


@pytest.mark.parametrize(("key", "text", "toml"), BAD)
def test_bad_value_is_refused_with_place_and_cure(
    tmp_path: Path, key: str, text: str, toml: str
) -> None:
    """Out of range or unknown: the message names the option, or file, line and key, and a cure."""
    with pytest.raises(SettingsError) as caught:
        served(f"{flag(key)}={text}")
    assert str(caught.value).startswith(f"{flag(key)}: ")
    assert "write " in str(caught.value)
    path = written(tmp_path, f"# a comment\n\n{key} = {toml}\n")
    with pytest.raises(SettingsError) as caught:
        load_settings({}, path)
    assert str(caught.value).startswith(f"{path}: line 3: {key}: ")
    assert "write " in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("key", "toml"), ILL_TYPED)
def test_ill_typed_value_is_refused(tmp_path: Path, key: str, toml: str) -> None:
    """A value of another type is refused, never converted."""
    path = written(tmp_path, f"{key} = {toml}\n")
    with pytest.raises(SettingsError) as caught:
        load_settings({}, path)
    assert str(caught.value).startswith(f"{path}: line 1: {key}: ")


@pytest.mark.parametrize("option", NUMBERS, ids=lambda option: option.key)
def test_numbers_keep_within_their_limits(tmp_path: Path, option) -> None:
    """One below, one above, and what is no number are refused in either place."""
    limits = option.declared.limits
    for value in (limits.low - 1, limits.high * 2 + 1, math.nan, "many", "true"):
        with pytest.raises(SettingsError, match=rf"^{option.flag}: .*write a "):
            option.read_text(str(value))
    for value in (limits.low - 1, limits.high * 2 + 1, "nan", "true", '"many"', "[1]", "{}"):
        path = written(tmp_path, f"{option.key} = {value}\n")
        with pytest.raises(SettingsError, match=rf"lab\.toml: line 1: {option.key}: .*write a "):
            load_settings({}, path)


@pytest.mark.parametrize(
    ("line", "cure"),
    [
        ("prot = 1", "did you mean port?"),
        ("Speed = 1", "did you mean speed?"),
        ("imageport = 1", "did you mean image_port?"),
        ("[worlds]", "did you mean world?"),
        ('"second-init " = 1', "did you mean second_init?"),
        ("config = 1", "known keys: allow_outside,"),
        ("qqq.a = 1", "known keys: allow_outside,"),
    ],
)
def test_unknown_key_is_refused_with_the_nearest_one(tmp_path: Path, line: str, cure: str) -> None:
    """A misspelt key is an error that suggests the right one, or else lists all."""
    path = written(tmp_path, f"seed = 1\n{line}\n")
    with pytest.raises(SettingsError) as caught:
        load_settings({}, path)
    assert str(caught.value).startswith(f"{path}: line 2: ")
    assert "unknown key" in str(caught.value)
    assert cure in str(caught.value)


def test_near_word_is_suggested_for_a_value() -> None:
    """A misspelt word as value gets the same help."""
    with pytest.raises(SettingsError, match=r"'ut2005' is not known \(did you mean ut2004"):
        served("--dialect", "ut2005")


def test_key_in_both_spellings_is_refused(tmp_path: Path) -> None:
    """One setting written with a hyphen and with an underscore is ambiguous."""
    path = written(tmp_path, "image_port = 1\nimage-port = 2\n")
    with pytest.raises(SettingsError, match="line 2: image-port: given twice"):
        load_settings({}, path)


def test_port_for_two_services_is_refused(tmp_path: Path) -> None:
    """Two services that are told the same port are an error that names both places."""
    path = written(tmp_path, "image_port = 4000\n")
    with pytest.raises(SettingsError) as caught:
        served("--config", str(path), "--truth-port", "4000")
    assert str(caught.value).startswith("--truth-port: port 4000")
    assert f"{path}: image_port" in str(caught.value)


@pytest.mark.parametrize("value", ["0", "off"])
def test_free_and_switched_off_ports_never_clash(value: str) -> None:
    """Any number of services may take free ports or be off."""
    found = served("--port", value, "--image-port", value, "--truth-port", value)
    assert found.port == found.image_port == found.truth_port


def test_control_may_take_the_default_port_of_another_service() -> None:
    """Only ports that were both written clash; a default gives way when it is bound."""
    assert served("--port", "5003").port == 5003


def test_missing_file_is_refused(tmp_path: Path) -> None:
    """The path of a file that does not exist is named."""
    path = tmp_path / "none.toml"
    with pytest.raises(SettingsError, match=r"none\.toml: no such file"):
        load_settings({}, path)


def test_folder_instead_of_a_file_is_refused(tmp_path: Path) -> None:
    """A path that cannot be read says why."""
    with pytest.raises(SettingsError, match="cannot be read: it is a folder"):
        load_settings({}, tmp_path)


def test_file_that_is_not_toml_is_refused_with_the_line(tmp_path: Path) -> None:
    """A syntax error names its line and column."""
    path = written(tmp_path, "seed = 1\nport = = 2\n")
    with pytest.raises(SettingsError, match=r"line 2, column 8: is not valid TOML"):
        load_settings({}, path)


def test_file_that_is_not_utf8_is_refused(tmp_path: Path) -> None:
    """Bytes that are no UTF-8 text are explained."""
    path = tmp_path / "lab.toml"
    path.write_bytes(b'world = "caf\xe9"\n')
    with pytest.raises(SettingsError, match="not UTF-8 text"):
        load_settings({}, path)


def test_long_value_is_shortened_in_the_message() -> None:
    """A message stays readable whatever was given."""
    with pytest.raises(SettingsError) as caught:
        served("--dialect", "x" * 5000)
    assert len(str(caught.value)) < 200


ROBOTS = next(option for option in OPTIONS if option.key == "robots")
WORLD = next(option for option in OPTIONS if option.key == "world")


def outcome(read) -> tuple[object, str | None]:
    """What a reader returns, or the text of its refusal; any other exception is a defect."""
    try:
        return read(), None
    except SettingsError as error:
        return type(error), str(error)


def test_robots_have_room_for_their_connections(tmp_path: Path) -> None:
    """More robots than the default number of connections can connect, unless the file forbids."""
    assert served().connections == 64
    assert served("--max-robots=128").connections > 128
    file = written(tmp_path, "max_connections = 70\nmax_robots = 128\n")
    assert load_settings({}, file).connections == 70


@given(st.sampled_from(OPTIONS), st.text(max_size=20))
@example(ROBOTS, "~nobody")
@example(ROBOTS, "a\0b")
@example(WORLD, "~nobody/b2")
@settings(max_examples=300, deadline=None)
def test_any_text_gives_settings_or_a_settings_error(option, text: str) -> None:
    """Whatever stands on the command line: a value, or a `SettingsError` in one line."""
    found, message = outcome(lambda: load_settings({option.key: text}))
    if message is None:
        assert isinstance(found, Settings)
    else:
        assert found is SettingsError
        assert message.startswith(f"{option.flag}: ")
        assert not {"\n", "\r", "\t", "\0"} & set(message)


TOML_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=5,
)


@given(st.sampled_from(OPTIONS), TOML_VALUES)
@settings(max_examples=300, deadline=None)
def test_any_value_of_the_file_is_taken_or_refused_in_words(option, value: object) -> None:
    """Whatever type a file gives: a value of the field, or a `SettingsError` with a text."""
    found, message = outcome(lambda: option.read(value))
    assert message is None or (found is SettingsError and message)


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
