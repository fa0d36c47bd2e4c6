"""The openings of protocol reference 5.1, played by clients with the originals' reading rules."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from legacy_clients import Iridium, Maldo, Player, Ros, SliderController
from legacy_lab_clients import Ades, AutToolbox, Rdk, UvaRescue, UvaStudent

from usarsim_server.testing import ServerProcess


@pytest.fixture(scope="module")
def arena() -> Iterator[int]:
    """Port of a server whose walls, tags and victims give the sensors something to say."""
    with ServerProcess("--world", "arena", "--max-robots", "32") as process:
        yield process.ports["control"]


@pytest.fixture(scope="module")
def fast_arena() -> Iterator[int]:
    """The same at up to eight times real time, for clients that read long."""
    with ServerProcess("--world", "arena", "--max-robots", "32", "--speed", "8") as process:
        yield process.ports["control"]


def test_player(fast_arena: int) -> None:
    """Player configures its devices and reads 100 sonar and laser lines (protocol 179)."""
    with Player(fast_arena) as player:
        player.send(
            "INIT {ClassName USARBot.P2AT} {Name player} {Location -10.6 7.0 -0.25} "
            "{Rotation 0.000000 0.000000 0.000000}"
        )
        for wire_type in ("Robot", "Sonar", "RangeScanner"):
            player.send(f"GETGEO {{Type {wire_type}}}")
            player.send(f"GETCONF {{Type {wire_type}}}")
        player.read_until(lambda: min(len(player.sonars), len(player.scans)) >= 100)
        sixteen = [f"{ring}{i}" for ring in "FR" for i in range(1, 9)]
        assert all(list(reading) == sixteen for reading in player.sonars)
        assert all(len(scan) == 181 for scan in player.scans)
        assert list(player.mounts) == [*sixteen, "Scanner1"]
        # Player mirrors y and yaw: the first sonar looks to the left.
        assert player.mounts["F1"][0][1] < 0.0
        assert player.mounts["F1"][1][2] == pytest.approx(-1.5707, abs=1e-3)
        assert player.limits == (20.0, 0.0174, 3.1415)
        assert player.robot["SteeringType"] == "SkidSteered"
        assert float(player.robot["WheelRadius"]) == 0.13
        assert len(player.robot["Dimensions"].split(",")) == 3
        # The wall of the hall, 3 m to the right, is where the driver's list begins (protocol 104).
        assert player.scans[-1][0] == pytest.approx(3.0, abs=0.01)
        assert player.scans[-1][-1] == pytest.approx(17.0, abs=0.05)


def test_maldo(fast_arena: int) -> None:
    """The index-based Java client reads 100 lines of every type it knows (protocol 180)."""
    wanted = ("STA", "Sonar", "RangeScanner", "Odometry", "INS", "GroundTruth", "GPS")
    with Maldo(fast_arena) as client:
        client.send(
            "INIT {ClassName USARBot.P2AT} {Name R1} {Location -10,6 5,0 -0,25} {Rotation 0 0 0}"
        )
        client.send("GETCONF {Type Robot}")
        client.read_until(lambda: all(client.read.get(kind, 0) >= 100 for kind in wanted))
        assert client.status is not None
        assert client.status[:4] == (0.0, 0.0, False, 0)
        assert client.status[5] >= 0, "the number of a camera picture"
        x, y, _ = (float(text) for text in client.values["GroundTruth"][0].split(","))
        assert (x, y) == pytest.approx((-10.6, 5.0), abs=0.05)
        assert len(client.values["RangeScanner"][2].split(",")) == 181
        client.send("DRIVE {Left 2.0} {Right 2.0} {Normalized false}")
        before = float(client.values["Odometry"][0].split(",")[0])
        client.read_until(lambda: float(client.values["Odometry"][0].split(",")[0]) > before + 0.2)


def test_ros(fast_arena: int) -> None:
    """Every sensor of a P3AT reaches the configured state; odometry and scans flow
    (protocol 181)."""
    with Ros(fast_arena) as driver:
        driver.send(
            "GETSTARTPOSES\r\nINIT {Classname USARBot.P3AT} {Name rover} {Start RobotStart3}\r\n"
            "GETCONF {Type RFID}\r\nGETGEO {Type RFID}"
        )

        def configured() -> bool:
            ready = all(state == "ready" for state in driver.found.values())
            return ready and len(driver.found) >= 8 and bool(driver.scans and driver.poses)

        driver.read_until(configured)
        types = {wire_type for wire_type, _ in driver.found}
        assert {"Robot", "RangeScanner", "Odometry", "INS", "GroundTruth", "Encoder"} <= types
        assert "Sonar" not in types, "the UDK class has none"
        assert driver.errors == []
        assert len(driver.scans[-1]) == 181
        assert driver.robot["SteeringType"] == ["SkidSteered"]
        driver.poses.clear()
        driver.drive(0.06, 0.15)
        driver.read_until(lambda: bool(driver.poses) and driver.poses[-1][2] < -0.2)
        assert driver.poses[-1][0] > 0.01, "forward and anticlockwise, as ROS counts"


def test_iridium(arena: int) -> None:
    """Level, start poses, battery and sensors come through, nothing ends the reader
    (protocol 182)."""
    with Iridium(arena) as console:
        console.send("GETSTARTPOSES")
        console.read_until(lambda: bool(console.starts))
        assert console.level == "arena"
        assert len(console.starts) == 16
        assert console.starts["RobotStart1"] == ((-10.6, 7.0, -0.25), (0.0, 0.0, 0.0))
        console.send("INIT {ClassName USARBot.P3AT} {Start RobotStart5}")
        console.send("GETCONF {Type Actuator}")
        console.send("DRIVE {Left 1.30} {Right 1.30}")

        def shown() -> bool:
            return all(
                console.shown.get(kind, 0) >= 5
                for kind in ("STA", "RangeScanner", "GroundTruth", "INS", "Tachometer")
            )

        console.read_until(shown)
        assert console.battery is not None
        assert 1100 < console.battery <= 1200
        console.send(
            "DRIVE {Left 0.00} {Right 0.00} {Speed 0.00} {FrontSteer 0.00} {RearSteer 0.00} "
            "{AltitudeVelocity 0.00} {LinearVelocity 0.00} {LateralVelocity 0.00} "
            "{RotationalVelocity 0.00}"
        )
        console.shown.clear()
        console.read_until(shown)


def test_slider_controller(arena: int) -> None:
    """It reads one line after its question, gets sliders, and moves a link (protocol 142, 158,
    183)."""
    with SliderController(arena) as client:
        client.start("INIT {ClassName USARBot.P2AT} {Start RobotStart7}")
        assert client.name == "CameraPanTilt"
        assert list(client.sliders) == [1, 2]
        low, high = client.sliders[2]
        assert low < 0.1 < high
        client.send("ACT {Name CameraPanTilt} {Link 1} {Value 0.1}")
        client.read_until(lambda: client.reached.get(2, 0.0) > 0.08)


def test_aut_toolbox(arena: int) -> None:
    """Each reading function returns within its half second, again and again (protocol 184)."""
    with AutToolbox(arena) as toolbox:
        toolbox.send("INIT {ClassName USARBot.P2AT} {Location -9.2,-1.0,-0.25} {Rotation 0,0,0}")
        toolbox.pass_by(1.0)
        for _ in range(4):
            assert len(toolbox.vector("Odometry", "Pose")) == 3
            assert len(toolbox.vector("GroundTruth", "Orientation")) == 3
            assert list(toolbox.sonars()) == [f"{ring}{i}" for ring in "FR" for i in range(1, 9)]
            assert re.search(r"\{Latitude \d+,[\d.]+,[NS]\}", toolbox.sense("GPS"))
        x, *_ = toolbox.vector("GroundTruth", "Location")
        toolbox.send("DRIVE {Left 1.0}")
        toolbox.send("DRIVE {Right 1.0} {Light True} {Normalized False}")
        toolbox.pass_by(0.8)
        assert toolbox.vector("GroundTruth", "Location")[0] > x + 0.05


def test_rdk(arena: int) -> None:
    """It starts from the first start pose, accepts STA and laser, drops a tag (protocol 185)."""
    with Rdk(arena) as client:
        location, rotation = client.first_start_pose()
        client.send(
            f"INIT {{ClassName USARBot.RescueP2AT}}{{Name rdk}}{{Location {location}}}"
            f"{{Rotation {rotation}}}"
        )
        client.read_until(lambda: client.status is not None and len(client.scans) > 2)
        assert client.status is not None
        assert client.status[1] >= 0, "the number of a camera picture"
        known = set(client.tags)
        client.send("SET {Type RFIDReleaser} {Name Gun} {Opcode Release}", end=b"")
        client.send("DRIVE {Left 0.001} {Right 0.001}")
        client.read_until(lambda: "RFIDReleaser" in client.confirmed)
        client.read_until(lambda: len(client.tags - known) == 1)


def test_uva_student(arena: int) -> None:
    """1024 bytes at a time, places in the line fixed: pose and sonars are found (protocol 186)."""
    with UvaStudent(arena) as student:
        student.send("INIT {ClassName USARBot.P2AT} {Location -9.2,3.0,-0.25} {Name s}")
        student.read_until(lambda: len(student.sonars) == 8 and len(student.pose) == 3)
        student.send("TRACE {On true} {Interval 0.1} {Color Red}")
        student.send("DRIVE {Light true}")
        student.send("DRIVE {Left 20} {Right 20} {Normalized true}")
        student.read_until(lambda: student.pose[0] > 0.1)


def test_uva_rescue(arena: int) -> None:
    """The robot's model is found, sonars are mounted HARD, LF and `0,5` drive (protocol 187,
    188)."""
    with UvaRescue(arena) as client:
        client.send("INIT {ClassName USARBot.P2AT} {Name Blue One} {Start robotstart9}")
        assert client.ask("GETCONF", "Robot", "Blue One")["Name"].endswith("P2AT")
        geometry = client.ask("GETGEO", "Robot", "Blue One")
        assert geometry["Type"] == "GroundVehicle"
        assert geometry["WheelRadius"] == "0.1300"
        for name in ("F1", "R8"):
            told = client.ask("GETGEO", "Sonar", name)
            assert told["Name"].startswith(f"{name} Location ")
            assert told["Name"].endswith("HARD")
        assert int(client.next("STA")["View"]) >= 0, "the number of a camera picture"
        start = float(client.next("SEN", "Odometry")["Pose"].split(",")[0])
        client.send("MULTIDRIVE {FRFlipper 0,5}")
        client.send("DRIVE {Left 0,5} {Right 0,5} {Normalized False}")
        end = start
        for _ in range(25):
            end = float(client.next("SEN", "Odometry")["Pose"].split(",")[0])
        assert end > start + 0.05, "it does not drive"


def test_chunk_reader(arena: int) -> None:
    """Chunks end where lines end as long as a client keeps up (protocol reference 1.1, 5.1.11)."""
    with Ades(arena) as client:
        client.send("INIT {ClassName P2AT} {Start RobotStart11}")
        whole = 0
        while whole < 60:
            chunk = client.chunk()
            for line in filter(None, chunk):
                # On a busy machine a chunk of 65536 bytes may fill; nothing else cuts a line.
                if re.fullmatch(r"[A-Z]+ \{.*\}", line):
                    whole += 1
                else:
                    assert len("\r\n".join(chunk)) == 65536, line


def test_one_receive_is_one_answer(arena: int) -> None:
    """A script that reads once after the greeting and once after GETGEO has its reply
    (protocol 5.1.12)."""
    with Ades(arena) as client:
        assert client.chunk()[0].startswith("NFO {Gametype")
        client.send("INIT {ClassName USARBot.P2AT} {Name p} {Location .4, .4, 1.8}")
        client.send("GETGEO {Type Robot}")
        assert client.chunk()[0].startswith("GEO {Type GroundVehicle} {Name P2AT}")


def test_values_hold_only_common_characters(arena: int) -> None:
    """Letters, digits, blank, point, comma, underscore, minus: all that AP2DX reads
    (protocol 5.1.10)."""
    with UvaRescue(arena) as client:
        client.send("INIT {ClassName USARBot.P2AT} {Start RobotStart13}")
        for _ in range(60):
            line = client.read_line()
            assert re.fullmatch(r"[A-Z]+( \{[A-Za-z0-9 .,_-]+\})+", line), line
