"""Propagation models reproduce the references; docs/wireless.md and settings files lead to them."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from radio_fakes import decibels, model

from usarsim_server.app import assemble
from usarsim_server.base import plugins
from usarsim_server.base.errors import SettingsError
from usarsim_server.options import load_settings
from usarsim_server.radio.configuration import read_radio
from usarsim_server.radio.event_log import Event
from usarsim_server.radio.models import (
    GROUP,
    NOTHING,
    TYPES,
    Propagation,
    model_names,
)


@pytest.mark.parametrize(
    ("distance", "strength"), [(2, -49.67), (10, -56.6597), (50, -63.6494), (100, -66.6597)]
)
@pytest.mark.parametrize("name", ["distance", "obstacle", "line-of-sight", "path-loss"])
def test_worked_values_without_obstacles(name: str, distance: float, strength: float) -> None:
    """The worked values of side channels 4.5, to four digits, for every model with its defaults."""
    assert round(model(name).strength(distance, 0), 4) == strength


@pytest.mark.parametrize(
    ("distance", "obstacles", "strength", "up"),
    [
        (10, 5, -88.285, True),
        (10, 6, -94.610, False),
        (50, 4, -88.949, True),
        (50, 5, -95.274, False),
        (2, 6, -87.62, True),
        (2, 7, -93.945, False),
    ],
)
def test_worked_values_with_obstacles(
    distance: float, obstacles: int, strength: float, up: bool
) -> None:
    """The obstacle model and its cutoff as worked out in side channels 4.5 (side channels 78)."""
    made = model("obstacle")
    value = made.strength(distance, obstacles)
    assert round(value, 3) == strength
    assert made.connects(value) is up


def test_cutoff_distance_of_the_defaults() -> None:
    """Distance alone cuts at 43,055.6 m (side channels 4.5)."""
    made = model("distance")
    assert made.connects(made.strength(43_055.5, 0))
    assert not made.connects(made.strength(43_055.7, 0))


def test_no_propagation() -> None:
    """The model `none` says 0 dBm and links everybody (side channels 4.5)."""
    made = model("none")
    assert made.strength(1e6, 1000) == 0.0
    assert made.connects(math.nan)
    assert not made.needs_positions


@pytest.mark.parametrize("name", ["distance", "obstacle", "path-loss", "line-of-sight"])
def test_nothing_in_between_is_infinite(name: str) -> None:
    """At the same place the signal is infinite and links (side channels 4.5)."""
    made = model(name)
    assert made.strength(0.0, 0) == math.inf
    assert made.connects(math.inf)
    assert not made.connects(math.nan)


def test_walls_count_up_to_a_number() -> None:
    """Path loss takes min(k, C) walls and subtracts (exploration 10.3, E-36)."""
    made = model("path-loss")
    free = made.strength(10, 0)
    assert [round(free - made.strength(10, k), 3) for k in (1, 4, 5, 6, 50)] == [
        6.325,
        25.3,
        31.625,
        31.625,
        31.625,
    ]


@pytest.mark.parametrize(("walls", "reach"), [(4, 127.0), (5, 29.6)])
def test_reach_behind_walls_with_the_preset_of_the_simulator(walls: int, reach: float) -> None:
    """29.6 m behind five walls, 127 m behind four, within 0.5 % (exploration E-37)."""
    made = model("path-loss", preset="usarsim")
    assert made.connects(made.strength(reach * 0.995, walls))
    assert not made.connects(made.strength(reach * 1.005, walls))


@pytest.mark.parametrize(("walls", "last"), [(0, 200), (1, 142), (2, 102), (3, 72)])
def test_reach_behind_walls_with_the_preset_of_mresim(walls: int, last: int) -> None:
    """With R = 200 a link holds to 200, 142, 102 and 72 m (exploration E-32, E-33)."""
    made = model("path-loss", preset="mresim", reference_distance=200)
    assert made.connects(made.strength(last, walls))
    assert not made.connects(made.strength(last + 1, walls))


def test_the_preset_of_the_paper() -> None:
    """Bahl and Padmanabhan: 3.1 dB a wall, at most four, exponent 1.5 (exploration 10.3)."""
    made = model("path-loss", preset="bahl")
    assert made.strength(20, 0) == pytest.approx(-49.67 - 15.0)
    assert made.strength(20, 9) == pytest.approx(-49.67 - 15.0 - 12.4)


def test_line_of_sight() -> None:
    """One obstacle ends a link, and so does the range if there is one (exploration E-39)."""
    made = model("line-of-sight", range=30)
    assert made.connects(made.strength(30, 0))
    assert made.strength(30, 1) == NOTHING
    assert made.strength(30.1, 0) == NOTHING
    assert not made.connects(NOTHING)
    assert model("line-of-sight").strength(500, 0) == pytest.approx(decibels(500, -49.67, 1, 2))


@given(
    st.floats(0.01, 1e5),
    st.floats(1.01, 10.0),
    st.integers(0, 20),
    st.sampled_from(["distance", "obstacle", "path-loss", "line-of-sight"]),
)
def test_signals_fall_with_distance_and_walls(
    distance: float, factor: float, walls: int, name: str
) -> None:
    """Further away and behind one more wall a signal is never stronger."""
    made = model(name)
    here = made.strength(distance, walls)
    assert made.strength(distance * factor, walls) <= here
    assert made.strength(distance, walls + 1) <= here


@given(st.floats(0.1, 1e5), st.floats(0.5, 5), st.floats(-90, 0), st.floats(0.5, 20))
def test_the_law_has_its_constants(d: float, n: float, power: float, d0: float) -> None:
    """All constants of the log-distance law can be set."""
    keys = {"path_loss_exponent": n, "reference_power": power, "reference_distance": d0}
    assert model("distance", **keys).strength(d, 0) == pytest.approx(decibels(d, power, n, d0))


def test_models_have_names_of_the_original() -> None:
    """The original's plug-in names work too, in any case."""
    assert {"none", "distance", "obstacle", "line-of-sight", "path-loss"} <= set(model_names())
    assert type(model("NOOP")) is type(model("none"))
    assert type(model("DistanceOnly")) is type(model("distance"))


@pytest.mark.parametrize(
    ("name", "keys", "words"),
    [
        ("obstacel", {}, "unknown propagation model 'obstacel' (known models: distance"),
        ("obstacle", {"cutoff": "low"}, "test: cutoff: 'low' is not a number (write a number"),
        ("obstacle", {"wall_attenuation": -1}, "wall_attenuation: -1 is out of range"),
        (
            "distance",
            {"wall_attenuation": 3},
            "wall_attenuation: unknown key",
        ),
        ("path-loss", {"preset": "x"}, "preset: 'x' is not known (write one of usarsim, mresim"),
        (
            "path-loss",
            {"max_walls": 2.5},
            "2.5 is not a whole number (write a whole number",
        ),
        ("distance", {"reference_distance": 0}, "write a number greater than 0"),
        ("distance", {"cutoff": float("nan")}, "cutoff: nan is not a finite number"),
        ("distance", {"cutoff": True}, "cutoff: True is not a number"),
        ("distance", {"cutoff": 10**400}, "cutoff: 1000"),
    ],
)
def test_mistakes_are_told(name: str, keys: dict[str, object], words: str) -> None:
    """A wrong name, key or value is one error that names place and cure."""
    with pytest.raises(SettingsError) as caught:
        model(name, **keys)
    assert words in str(caught.value)


def test_models_of_other_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    """A class in the entry point group is a model like the others; a broken one is told so."""

    class Tunnel(Propagation):
        """Everything arrives with half its metres as loss."""

        def strength(self, distance: float, obstacles: int) -> float:
            return -distance / 2

    points = [
        EntryPoint("tunnel", "elsewhere:Tunnel", GROUP),
        EntryPoint("wreck", "no_such_package:Model", GROUP),
    ]
    monkeypatch.setattr(plugins, "entry_points", lambda group: points if group == GROUP else [])
    monkeypatch.setattr(
        EntryPoint, "load", lambda self: Tunnel if self.name == "tunnel" else _missing()
    )
    monkeypatch.setattr(TYPES, "_discovered", False)
    monkeypatch.setattr(TYPES, "_types", dict(TYPES._types))
    monkeypatch.setattr(TYPES, "_broken", {})
    assert model("Tunnel").strength(100, 3) == -50.0
    with pytest.raises(SettingsError, match="wreck"):
        model("wreck")


def _missing() -> type:
    raise ImportError("no such package")


TEXT = (Path(__file__).parents[2] / "docs" / "wireless.md").read_text(encoding="utf-8")


def blocks(language: str) -> Iterator[str]:
    """The code blocks of a language."""
    return iter(re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL))


def test_the_example_of_settings_is_accepted() -> None:
    """Every key of the example exists and has a value that fits."""
    (table,) = (tomllib.loads(text) for text in blocks("toml") if text.startswith("[wireless]"))
    options = read_radio(table["wireless"], "docs/wireless.md")
    assert options.model.connects(options.model.strength(30.0, 0))
    assert not options.model.connects(options.model.strength(30.1, 0))


def test_all_models_and_events_are_described() -> None:
    """No model and no event is missing."""
    for name in (*model_names(), *Event):
        assert f"`{name}`" in TEXT


QUIET = """
world = "empty"
port = 0
image_port = "off"
groundtruth_port = "off"
truth_port = "off"
"""


def services(file: Path, text: str) -> list[str]:
    """Names of the services that a settings file asks for."""
    file.write_text(QUIET + text)
    assembly = assemble(load_settings({}, file))
    assembly.stop()
    return [service.name for service in assembly.services]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("", ["control", "wireless"]),
        ('wireless_port = "off"', ["control"]),
        ("comserver_port = 0", ["control", "wireless", "comserver"]),
        ('wireless_port = "off"\ncomserver_port = 0', ["control", "comserver"]),
        ('[wireless]\nmodel = "none"', ["control", "wireless"]),
    ],
)
def test_services_as_asked_for(tmp_path: Path, text: str, names: list[str]) -> None:
    """50000 is on and can be left to others, 5874 is off unless asked for (side channels 99,
    100)."""
    assert services(tmp_path / "lab.toml", text) == names


def test_a_radio_file_beside_the_settings(tmp_path: Path) -> None:
    """Its path starts at the settings file, and its mistakes are told with its name."""
    (tmp_path / "radio.toml").write_text('model = "distance"\ncutof = -90\n')
    with pytest.raises(SettingsError) as caught:
        services(tmp_path / "lab.toml", 'wireless = "radio.toml"')
    assert str(caught.value).startswith(f"{tmp_path}/radio.toml: cutof: unknown key")


@pytest.mark.parametrize("text", ["wireless = 3", 'wireless_model = ""', "wireless_log = true"])
def test_values_of_a_wrong_kind(tmp_path: Path, text: str) -> None:
    """They are refused where they stand."""
    with pytest.raises(SettingsError, match=r"lab\.toml: line 7: wireless"):
        services(tmp_path / "lab.toml", text)
