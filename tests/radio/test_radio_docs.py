"""docs/wireless.md says what the program does."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

from usarsim_server.radio.configuration import read_radio
from usarsim_server.radio.event_log import Event
from usarsim_server.radio.models import model_names

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
