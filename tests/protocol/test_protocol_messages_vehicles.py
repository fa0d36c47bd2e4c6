"""STA, GEO and CONF of vehicles that drive, fly, walk and dive (protocol reference 4.3, 4.4, 4.7,
4.8, 6.6, 6.8); CONF of cameras and RES of viewports, exactly as the original wrote them.
"""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol import messages
from usarsim_server.protocol.messages import (
    CameraItem,
    GroundStatus,
    VehicleStatus,
    aerial_status,
    camera_configuration,
    ground_configuration,
    ground_geometry,
    ground_status,
    static_configuration,
    static_geometry,
    static_status,
    viewports_result,
)
from usarsim_server.protocol.numbers import fixed
from usarsim_server.protocol.values import Dialect

UT2004, UDK = Dialect.UT2004, Dialect.UDK

GROUND_UT2004 = re.compile(
    r"^STA \{Type GroundVehicle\} \{Time \d+\.\d\d\} \{FrontSteer -?\d+\.\d{4}\} "
    r"\{RearSteer -?\d+\.\d{4}\}( \{\w+ -?\d+\.\d{4}\})* \{LightToggle (True|False)\} "
    r"\{LightIntensity \d+\} \{Battery \d+\} \{View -?\d+\}$"
)
SKID_UDK = re.compile(
    r"^STA \{Time \d+\.\d{4}\} \{Battery \d+\} \{Type GroundVehicle\} "
    r"\{LightToggle (True|False)\} \{LightIntensity 100\} \{FrontSteer 0\} \{RearSteer 0\}$"
)
FLIPPERS = (
    ("FRFlipper", 0.78539),
    ("FLFlipper", 0.78539),
    ("RRFlipper", -0.2),
    ("RLFlipper", -0.2),
)

ground_statuses = st.builds(
    GroundStatus,
    time=st.floats(),
    front_steer=st.floats(),
    rear_steer=st.floats(),
    joints=st.sampled_from([(), FLIPPERS]),
    light=st.booleans(),
    light_intensity=st.integers(),
    battery=st.integers(),
    view=st.integers(min_value=-1, max_value=63),
)


def test_ground_status_ut2004() -> None:
    """Protocol 85: the order of the UT2004 server with View, Time with two digits."""
    status = GroundStatus(time=63.4, battery=1188)
    assert ground_status(status, UT2004) == (
        "STA {Type GroundVehicle} {Time 63.40} {FrontSteer 0.0000} {RearSteer 0.0000} "
        "{LightToggle False} {LightIntensity 0} {Battery 1188} {View -1}"
    )


def test_ground_status_with_flippers() -> None:
    """Protocol 88: flippers stand between RearSteer and LightToggle in the order given."""
    status = GroundStatus(
        time=63.4, joints=FLIPPERS, light=True, light_intensity=100, battery=1188, view=0
    )
    assert ground_status(status, UT2004) == (
        "STA {Type GroundVehicle} {Time 63.40} {FrontSteer 0.0000} {RearSteer 0.0000} "
        "{FRFlipper 0.7853} {FLFlipper 0.7853} {RRFlipper -0.2000} {RLFlipper -0.2000} "
        "{LightToggle True} {LightIntensity 100} {Battery 1188} {View 0}"
    )


def test_ground_status_udk_keeps_the_order_that_all_clients_read() -> None:
    """Protocol 5.2 no. 1 and 66: `udk` differs in the digits of Time only."""
    status = GroundStatus(time=63.4021, battery=1187)
    assert ground_status(status, UDK) == (
        "STA {Type GroundVehicle} {Time 63.4021} {FrontSteer 0.0000} {RearSteer 0.0000} "
        "{LightToggle False} {LightIntensity 0} {Battery 1187} {View -1}"
    )


def test_exact_udk_form_of_skid_steer() -> None:
    """Protocol 86: on request the exact UDK order, with literal zeros and LightIntensity 100."""
    status = GroundStatus(time=63.4021, battery=1187, light_intensity=0, front_steer=0.5)
    expected = (
        "STA {Time 63.4021} {Battery 1187} {Type GroundVehicle} {LightToggle False} "
        "{LightIntensity 100} {FrontSteer 0} {RearSteer 0}"
    )
    assert ground_status(status, UDK, udk_order=True) == expected
    assert ground_status(status, UT2004, udk_order=True) == ground_status(status, UT2004)


def test_exact_udk_form_of_a_steered_robot() -> None:
    """Protocol 4.3: with steering joints the angles are printed."""
    status = GroundStatus(time=63.4021, light=True, front_steer=0.25, steered=True)
    assert ground_status(status, UDK, udk_order=True) == (
        "STA {Time 63.4021} {Battery 99999} {Type GroundVehicle} {LightToggle True} "
        "{LightIntensity 100} {FrontSteer 0.2500} {RearSteer 0.0000}"
    )


@given(ground_statuses)
def test_every_ut2004_status_matches(status: GroundStatus) -> None:
    """Protocol 85, 89: whatever the numbers, the line has the shape that strict readers index."""
    assert GROUND_UT2004.match(ground_status(status, UT2004))


@given(ground_statuses)
def test_every_exact_udk_status_matches(status: GroundStatus) -> None:
    """Protocol 86, 89: the same for the exact UDK form of skid steer."""
    assert SKID_UDK.match(ground_status(status, UDK, udk_order=True))


@pytest.mark.parametrize("battery", [-3, 0])
def test_battery_is_never_negative(battery: int) -> None:
    """Protocol 89, 92: a dead battery reads 0."""
    assert "{Battery 0}" in ground_status(GroundStatus(time=1, battery=battery), UT2004)


def test_no_battery_reads_99999() -> None:
    """Protocol 93: the default of a robot without battery."""
    assert "{Battery 99999}" in ground_status(GroundStatus(time=1), UDK)


def test_a_joint_with_a_blank_in_its_name_is_one_word() -> None:
    """Protocol 85: a joint key is a single word."""
    text = ground_status(GroundStatus(time=1, joints=(("Front Arm", 1),)), UT2004)
    assert "{Front_Arm 1.0000}" in text


def test_aerial_status() -> None:
    """Protocol 87: Type stands right behind the head."""
    status = VehicleStatus(time=12.3, battery=1192)
    assert aerial_status(status, UT2004) == (
        "STA {Type AerialVehicle} {Time 12.30} {LightToggle False} {LightIntensity 0} "
        "{Battery 1192} {View -1}"
    )
    assert aerial_status(status, UDK).startswith("STA {Type AerialVehicle} {Time 12.3000} ")


def test_exact_udk_form_of_an_aerial_status() -> None:
    """Protocol 5.2 no. 17: the UDK form has the Type that the original left out."""
    assert aerial_status(VehicleStatus(time=12.3047), UDK, udk_order=True) == (
        "STA {Time 12.3047} {Battery 99999} {Type AerialVehicle}"
    )


def test_ground_geometry() -> None:
    """Protocol 129, 133: Type, Name (the class), Dimensions, COG, radius, separation, base."""
    assert ground_geometry("P2AT", (0.52, 0.49, 0.29), (0, 0, 0), 0.13, 0.47, 0.288) == (
        "GEO {Type GroundVehicle} {Name P2AT} {Dimensions 0.5200,0.4900,0.2900} "
        "{COG 0.0000,0.0000,0.0000} {WheelRadius 0.1300} {WheelSeparation 0.4700} "
        "{WheelBase 0.2880}"
    )


def test_ground_configuration_ut2004() -> None:
    """Protocol 130: Type before Name, and four digits everywhere."""
    text = ground_configuration(UT2004, "P2DX", "SkidSteered", 9, 5.4, 50, 0, 0)
    assert text == (
        "CONF {Type GroundVehicle} {Name P2DX} {SteeringType SkidSteered} {Mass 9.0000} "
        "{MaxSpeed 5.4000} {MaxTorque 50.0000} {MaxFrontSteer 0.0000} {MaxRearSteer 0.0000}"
    )


def test_ground_configuration_udk() -> None:
    """Protocol 130: Name before Type, and literal zeros for the limits of skid steer."""
    text = ground_configuration(UDK, "BasicSkidRobot", "SkidSteered", 12.4, 1.4, 50000, 0.5, 0)
    assert text == (
        "CONF {Name BasicSkidRobot} {Type GroundVehicle} {SteeringType SkidSteered} "
        "{Mass 12.4000} {MaxSpeed 1.4000} {MaxTorque 50000.0000} {MaxFrontSteer 0} "
        "{MaxRearSteer 0}"
    )


def test_ground_configuration_of_a_car() -> None:
    """Protocol 4.8: Ackerman limits are printed in `udk`, too."""
    text = ground_configuration(UDK, "Car", "AckermanSteered", 1, 1, 1, 0.7, 0)
    assert text.endswith("{MaxFrontSteer 0.7000} {MaxRearSteer 0.0000}")


def test_status_of_a_platform() -> None:
    """Protocol 4.4: BaseMachine with Type and Time in `ut2004`; StaticPlatform with Battery in
    `udk`."""
    assert static_status(UT2004, 12.3047, 99999) == "STA {Type BaseMachine} {Time 12.30}"
    assert static_status(UDK, 12.3047, 99999) == (
        "STA {Time 12.3047} {Battery 99999} {Type StaticPlatform}"
    )
    assert "{Battery 0}" in static_status(UDK, 1.0, -3)


def test_geometry_of_a_platform() -> None:
    """Protocol 4.7: Type and Name; only `ut2004` tells dimensions."""
    assert static_geometry(UDK, "KR60", (1.0, 1.0, 0.0)) == "GEO {Type StaticPlatform} {Name KR60}"
    assert static_geometry(UT2004, "KR60", (1.0, 1.0, 0.0)) == (
        "GEO {Type BaseMachine} {Name KR60} {Dimensions 1.0000,1.0000,0.0000}"
    )


def test_configuration_of_a_platform() -> None:
    """Protocol 4.8, 130: Name first, no steering and no mass in `udk`; Type and Name in
    `ut2004`."""
    assert static_configuration(UDK, "KR60") == (
        "CONF {Name KR60} {Type StaticPlatform} {SteeringType None} {Mass 0}"
    )
    assert static_configuration(UT2004, "KR60") == "CONF {Type BaseMachine} {Name KR60}"


UT2004, UDK = Dialect.UT2004, Dialect.UDK


def test_geometry_of_a_flying_machine() -> None:
    """UT2004 tells sizes, UDK the name; both say what it is (protocol 5.2 no. 17)."""
    size, middle = (0.999, 0.999, 0.3), (0.0, 0.0, 0.01)
    assert messages.machine_geometry(UT2004, "AerialVehicle", "AirRobot", size, middle) == (
        "GEO {Type AerialVehicle} {Name AirRobot} {Dimensions 0.9990,0.9990,0.3000}"
        " {COG 0.0000,0.0000,0.0100}"
    )
    assert messages.machine_geometry(UDK, "AerialVehicle", "AirRobot", size, middle) == (
        "GEO {Type AerialVehicle} {Name AirRobot}"
    )


def test_configuration_starts_by_dialect() -> None:
    """Type comes first in UT2004, Name in UDK, as with ground vehicles (protocol 4.8)."""
    limits = [("MaxLinearVelocity", 2.0)]
    assert messages.machine_configuration(
        UT2004, "AerialVehicle", "AirRobot", "RotaryWing", 1.0, limits
    ) == (
        "CONF {Type AerialVehicle} {Name AirRobot} {SteeringType RotaryWing} {Mass 1.0000}"
        " {MaxLinearVelocity 2.0000}"
    )
    assert messages.machine_configuration(UDK, "LeggedRobot", "Nao", "TwoLegs", 5.0, []) == (
        "CONF {Name Nao} {Type LeggedRobot} {SteeringType TwoLegs} {Mass 5.0000}"
    )


def test_status_of_a_legged_machine() -> None:
    """The UDK line is the example of protocol 4.4; UT2004 adds lamp and view."""
    joints = [("HeadYaw", 0.0), ("HeadPitch", -0.12), ("LShoulderPitch", 1.3999)]
    assert messages.legged_status(
        messages.VehicleStatus(time=12.3047, light_intensity=100), joints, UDK
    ) == (
        "STA {Time 12.3047} {Battery 99999} {Type LeggedVehicle} {HeadYaw 0.0000}"
        " {HeadPitch -0.1200} {LShoulderPitch 1.3999}"
    )
    lit = messages.VehicleStatus(time=12.3, light=True, light_intensity=100, battery=77, view=2)
    assert messages.legged_status(lit, joints[:1], UT2004) == (
        "STA {Type LeggedRobot} {Time 12.30} {HeadYaw 0.0000} {LightToggle True}"
        " {LightIntensity 100} {Battery 77} {View 2}"
    )


@pytest.mark.parametrize("value", [0.00019999, -0.00001, -1.9999999, 3e14, -math.inf, math.nan])
def test_joints_are_told_as_single_numbers_are(value: float) -> None:
    """Whatever their names and places are."""
    joints = [("Left Knee", value), ("100%s", -0.5), ("{%", 7.0)]
    line = messages.legged_status(messages.VehicleStatus(time=1.0), joints, UDK)
    told = f"{{Left_Knee {fixed(value, 4)}}} {{100%s -0.5000}} {{(% 7.0000}}"
    assert line.partition("{Type LeggedVehicle} ")[2] == told


def test_status_of_an_underwater_machine() -> None:
    """RudderAngle and SternPlaneAngle stand behind Time (protocol 4.4)."""
    status = messages.VehicleStatus(time=1.25, battery=1199)
    assert messages.nautic_status(status, 0.1, -0.2, UT2004) == (
        "STA {Type NauticVehicle} {Time 1.25} {RudderAngle 0.1000} {SternPlaneAngle -0.2000}"
        " {LightToggle False} {LightIntensity 0} {Battery 1199} {View -1}"
    )


USUAL, NARROW, WIDE = (math.radians(angle) for angle in (80.0, 20.0, 120.0))


def test_exact_udk_form() -> None:
    """Protocol 138: the composed example of side channels reference 2.10, without blanks inside."""
    item = CameraItem(
        name="Camera",
        offset=(320, 0),
        default_fov=USUAL,
        min_fov=NARROW,
        max_fov=WIDE,
        fov=USUAL,
    )
    assert camera_configuration(Dialect.UDK, "Camera", [item]) == (
        "CONF {Type Camera} {Name Camera}{TextureOffsetX 320}{TextureOffsetY 0}"
        "{TextureResolutionX 320}{TextureResolutionY 240}{CameraDefFov 80.0000}"
        "{CameraMinFov 20.0000}{CameraMaxFov 120.0000}{CameraFov 80.0000}"
    )


def test_exact_ut2004_form() -> None:
    """Protocol 138, 9: radians, one blank between any two segments, no tiles."""
    line = camera_configuration(Dialect.UT2004, "Camera", [CameraItem(name="A")] * 2)
    one = "{Name A} {CameraDefFov 1.3963} {CameraMinFov 0.3491} {CameraMaxFov 2.0944}"
    assert line == f"CONF {{Type Camera}} {one} {{CameraFov 1.3963}} {one} {{CameraFov 1.3963}}"


def test_nothing_without_cameras() -> None:
    """Protocol 7: no camera, no line."""
    assert camera_configuration(Dialect.UDK, "Camera", []) == ""


def test_viewports_result_with_configuration() -> None:
    """Side channels reference 2.11: status after Config and after each viewport."""
    viewports = [("Camera2", True), *[("Disabled", True)] * 3]
    assert viewports_result(12.34, viewports, ("SingleView", True)) == (
        "RES {Time 12.34} {Type Viewports} {Config SingleView} {Status OK} {Viewport1 Camera2} "
        "{Status OK} {Viewport2 Disabled} {Status OK} {Viewport3 Disabled} {Status OK} "
        "{Viewport4 Disabled} {Status OK}"
    )
