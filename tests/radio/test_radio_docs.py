"""docs/wireless.md says what the program does."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from radio_fakes import decibels, model

from usarsim_server.radio.configuration import read_radio
from usarsim_server.radio.event_log import Event
from usarsim_server.radio.parameters import RadioParameters
from usarsim_server.radio.propagation import TYPES, Propagation, model_names

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
    defaults = read_radio({}, "defaults")
    for key in ("poll", "patience", "cache_distance", "share"):
        assert table["wireless"][key] == getattr(defaults, key)


def test_the_example_of_a_model_works(monkeypatch: pytest.MonkeyPatch) -> None:
    """The class of the example is a model that can be configured."""
    monkeypatch.setattr(TYPES, "_types", dict(TYPES._types))
    space: dict[str, type[Propagation]] = {}
    exec(next(blocks("python")), space)
    parameters = RadioParameters({"loss_per_metre": 1.0, "cutoff": -70}, "test")
    tunnel = space["Tunnel"](parameters)
    parameters.finish()
    assert tunnel.strength(10.0, 1) == -58.0
    assert tunnel.cutoff == -70.0


def test_all_models_and_events_are_described() -> None:
    """No model and no event is missing; the constants are those of the table."""
    for name in (*model_names(), *Event):
        assert f"`{name}`" in TEXT
    found = {key: float(value) for key, value in re.findall(r"`(\w+)` \w+ = (-?[\d.]+)", TEXT)}
    law = decibels(
        10.0,
        found["reference_power"],
        found["path_loss_exponent"],
        found["reference_distance"],
    )
    assert model("obstacle").strength(10.0, 2) == pytest.approx(law - 2 * found["wall_attenuation"])
    assert model("path-loss").strength(10.0, 99) == pytest.approx(
        law - found["max_walls"] * found["wall_attenuation"]
    )
