"""From the `[wireless]` table of a settings file to a model and all that goes with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from usarsim_server.errors import SettingsError
from usarsim_server.radio.fading import Fading, LinkShape
from usarsim_server.radio.parameters import RadioParameters
from usarsim_server.radio.propagation import Propagation, create_model
from usarsim_server.toml import read_toml

DEFAULT_MODEL = "obstacle"


@dataclass(frozen=True, slots=True, eq=False)
class RadioOptions:
    """How the wireless simulation works.

    Attributes:
        model: propagation.
        fading: random part of the signal.
        shape: of the traffic that links carry.
        poll: s of wall time between two looks at the world.
        patience: s of wall time that a registered station may be missing in the simulator.
        cache_distance: m that a station may move before obstacles are counted again.
        share: part of a processor that all links together may use.
    """

    model: Propagation
    fading: Fading
    shape: LinkShape
    poll: float = 0.25
    patience: float = 1.0
    cache_distance: float = 0.25
    share: float = 0.15


def read_radio(
    table: Mapping[str, object], place: str, model: str | None = None, seed: int = 0
) -> RadioOptions:
    """Read a table.

    Args:
        table: keys as in docs/wireless.md; the model's own stand among them.
        place: where it stands, for errors.
        model: name that wins over the table's.
        seed: of fading and loss, unless the table names one.

    Raises:
        SettingsError: for the first thing that is wrong, with place and cure.
    """
    parameters = RadioParameters(table, place)
    written = parameters.text("model", DEFAULT_MODEL)
    where = f"{place}: model" if model is None else "--wireless-model"
    chosen = create_model(model or written, parameters, where)
    options = RadioOptions(
        model=chosen,
        fading=Fading(
            parameters.number("fading", 0.0, low=0.0, high=100.0),
            parameters.number("fading_interval", 1.0, low=1e-3, high=1e6),
            parameters.count("seed", seed, low=0, high=2**63 - 1),
        ),
        shape=LinkShape(
            latency=parameters.number("latency", 0.0, low=0.0, high=60.0),
            bandwidth=parameters.number("bandwidth", 0.0, low=0.0, high=1e12),
            loss=parameters.number("loss", 0.0, low=0.0, high=0.9),
            retry_delay=parameters.number("retry_delay", 0.02, low=0.0, high=60.0),
        ),
        poll=parameters.number("poll", 0.25, low=0.02, high=60.0),
        patience=parameters.number("patience", 1.0, low=0.0, high=1e9),
        cache_distance=parameters.number("cache_distance", 0.25, low=0.0, high=1000.0),
        share=parameters.number("share", 0.15, low=0.01, high=64.0),
    )
    parameters.finish()
    return options


def read_radio_file(path: Path) -> dict[str, object]:
    """The table that a file of its own holds, with or without a `[wireless]` head.

    Raises:
        SettingsError: if it cannot be read or is not TOML.
    """
    table = read_toml(path, SettingsError, "wireless.obstacle")
    inner = table.get("wireless")
    return inner if isinstance(inner, dict) and len(table) == 1 else table
