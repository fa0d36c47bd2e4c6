"""`usarsim robots --check`: what the author of a robot file is shown, and when."""

from __future__ import annotations

from pathlib import Path

import pytest
from robot_files import SENSOR, table, write

from usarsim_server.cli.robot_check import check
from usarsim_server.errors import RobotDescriptionError


def test_what_is_wrong_is_told_before_anything_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A key that only the sensor itself refuses is found first, too."""
    path = write(tmp_path, "Bad", table(sensor=[{**SENSOR, "beem_angle": 1.0}]))
    with pytest.raises(RobotDescriptionError, match="beem_angle: unknown key of a Sonar"):
        check(path, [], None)
    assert capsys.readouterr().out == ""


def test_sensors_speak_beside_conf_geo_and_sta(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each sensor has a line in both dialects."""
    path = write(tmp_path, "Good", table(caster=[], wheel=table()["wheel"] + rear()))
    check(path, [], None)
    said = capsys.readouterr().out
    for head in ("CONF {", "GEO {", "STA {"):
        assert f"\n{head}" in said
    assert "{Type Sonar} {Name F1 Range 5.0000}" in said
    assert "{Type Sonar} {Name F1} {Range 5.0000}" in said


def rear() -> list[dict[str, object]]:
    """Two more wheels, so that it stands."""
    wheels = [{**one, "name": f"Rear{one['name']}"} for one in table()["wheel"]]
    for one in wheels:
        one["position"] = [-0.3, one["position"][1], one["position"][2]]
    return wheels
