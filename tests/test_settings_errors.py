"""Settings that do not fit: an error with place and cure for everything wrong."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from test_settings import flag, served, written

from usarsim_server.base.errors import SettingsError
from usarsim_server.options import OPTIONS, load_settings
from usarsim_server.settings import Settings

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
    with pytest.raises(SettingsError, match=r"lab.toml: line 1: byte 0xE9 is not UTF-8 \(save"):
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
