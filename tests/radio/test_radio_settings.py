"""A settings file decides which wireless services there are, and how they work."""

from __future__ import annotations

from pathlib import Path

import pytest

from usarsim_server.app import assemble
from usarsim_server.errors import SettingsError
from usarsim_server.options import load_settings

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
    """50000 is on and can be left to others, 5874 is off unless asked for (checks 99, 100)."""
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
