"""`--truth off`: nobody is told where robots really are, on no port and by no sensor."""

from __future__ import annotations

from pathlib import Path

import pytest

from usarsim_server.errors import SettingsError
from usarsim_server.settings import load_settings
from usarsim_server.testing import ScriptedClient, running_server

ROBOT = "INIT {ClassName USARBot.P3AT} {Name R1} {Location 0,0,-0.5}"
PORTS = {"groundtruth_port": 0, "truth_port": 0, "wireless_port": 0}


def heard(client: ScriptedClient) -> tuple[set[str], list[str]]:
    """Types that the robot's SEN lines name, and the answers about GroundTruth."""
    client.send(ROBOT)
    client.wait_for("SEN")
    client.send("GETCONF {Type GroundTruth}")
    client.send("GETGEO {Type GroundTruth}")
    lines = client.listen(1.0)
    types = {line.partition("{Type ")[2].partition("}")[0] for line in lines if "SEN" in line}
    return types, [line for line in lines if "GroundTruth" in line and "SEN" not in line]


@pytest.mark.parametrize("truth", ["on", "off"])
def test_ground_truth_is_told_or_not(truth: str) -> None:
    """Off: both ports are closed, GETPOS and GETOBS on the wireless port are unknown requests, the
    sensor is not mounted, and GETCONF and GETGEO know nothing of it."""
    with running_server(world="empty", truth=truth, **PORTS) as (_, endpoints):
        told = truth == "on"
        assert ("groundtruth" in endpoints) == ("truth" in endpoints) == told
        with ScriptedClient(endpoints["control"].port) as robot:
            types, facts = heard(robot)
            assert ("GroundTruth" in types) == bool(facts) == told
            assert "Odometry" in types
            for request in ("GETPOS", "GETOBS {From R1} {To R1}"):
                with ScriptedClient(endpoints["wireless"].port) as wireless:
                    wireless.send(request)
                    answer = wireless.read_line()
                    assert answer.startswith("ERROR") == (not told)
                    assert ("Location" in answer or "NUMOBS" in answer) == told
            with ScriptedClient(endpoints["wireless"].port) as wireless:
                wireless.send("INIT {Robot R1} {Port 1}")
                assert wireless.read_line() == "INITREPLY {Status OK}"


def test_the_switch_stands_in_files_too(tmp_path: Path) -> None:
    """And wins over ports that somebody asked for."""
    file = tmp_path / "lab.toml"
    file.write_text('truth = "off"\ntruth_port = 0\n')
    assert load_settings({}, file).truth == "off"
    assert load_settings({"truth": "on"}, file).truth == "on"
    with pytest.raises(SettingsError, match="truth"):
        load_settings({"truth": "perhaps"})
