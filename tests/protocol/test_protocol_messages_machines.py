"""STA, GEO and CONF of flying, walking and diving machines (protocol reference 4.4, 4.7, 4.8)."""

from __future__ import annotations

from usarsim_server.protocol import messages
from usarsim_server.protocol.values import Dialect

UT2004, UDK = Dialect.UT2004, Dialect.UDK


def test_geometry_of_a_flying_machine() -> None:
    """UT2004 tells sizes, UDK the name; both say what it is (5.2 no. 17)."""
    size, middle = (0.999, 0.999, 0.3), (0.0, 0.0, 0.01)
    assert messages.machine_geometry(UT2004, "AerialVehicle", "AirRobot", size, middle) == (
        "GEO {Type AerialVehicle} {Name AirRobot} {Dimensions 0.9990,0.9990,0.3000}"
        " {COG 0.0000,0.0000,0.0100}"
    )
    assert messages.machine_geometry(UDK, "AerialVehicle", "AirRobot", size, middle) == (
        "GEO {Type AerialVehicle} {Name AirRobot}"
    )


def test_configuration_starts_by_dialect() -> None:
    """Type comes first in UT2004, Name in UDK, as with ground vehicles (4.8)."""
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
    """The UDK line is the example of 4.4; UT2004 adds lamp and view."""
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


def test_status_of_an_underwater_machine() -> None:
    """RudderAngle and SternPlaneAngle stand behind Time (4.4)."""
    status = messages.VehicleStatus(time=1.25, battery=1199)
    assert messages.nautic_status(status, 0.1, -0.2, UT2004) == (
        "STA {Type NauticVehicle} {Time 1.25} {RudderAngle 0.1000} {SternPlaneAngle -0.2000}"
        " {LightToggle False} {LightIntensity 0} {Battery 1199} {View -1}"
    )
