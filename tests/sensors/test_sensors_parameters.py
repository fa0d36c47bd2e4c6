"""Robot files: keys of a sensor are checked, and every mistake names file, item, key and cure."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_fakes import describe_item

from usarsim_server.errors import RobotDescriptionError
from usarsim_server.sensors.parameters import Parameters

PLACE = "robots/p3at.toml: [[sensor]] number 1 (lms200)"


def parameters(**keys: object) -> Parameters:
    return Parameters(describe_item("SICK", "lms200", **keys))


def test_an_absent_key_gives_the_default() -> None:
    """Readers return their default when the file says nothing."""
    read = parameters()
    assert read.number("fov", 3.0) == 3.0
    assert read.count("cones", 2, minimum=0, maximum=10) == 2
    assert read.flag("literal", True) is True
    assert read.choice("of", "robot", ("robot", "sensor")) == "robot"
    assert read.optional_number("interval", minimum=0.0) is None


def test_given_values_are_returned() -> None:
    """Readers return what the file says; whole numbers serve as numbers."""
    read = parameters(fov=3, cones=4, literal=False, of=" Sensor ", interval=0)
    assert read.number("fov", 1.0) == 3.0
    assert isinstance(read.number("fov", 1.0), float)
    assert read.count("cones", 2, minimum=0, maximum=10) == 4
    assert read.flag("literal", True) is False
    assert read.choice("of", "robot", ("robot", "sensor")) == "sensor"
    assert read.optional_number("interval", minimum=0.0) == 0.0


@pytest.mark.parametrize(
    "value", ["far", True, [1.0], {"m": 1}, math.inf, -math.inf, math.nan, 10**400]
)
def test_a_number_of_another_kind_is_refused_with_an_example(value: object) -> None:
    """The message has the place, the key, the value and what to write instead."""
    with pytest.raises(RobotDescriptionError) as error:
        parameters(max_range=value).number("max_range", 20.0)
    text = str(error.value)
    assert text.startswith(f"{PLACE}: max_range: ")
    assert repr(value) in text
    assert text.endswith("for example max_range = 20)")


@pytest.mark.parametrize(
    ("value", "limits"),
    [
        (-1.0, {"minimum": 0.0}),
        (0.0, {"above": 0.0}),
        (7.5, {"maximum": 7.0}),
    ],
)
def test_a_number_out_of_range_is_refused(value: float, limits: dict[str, float]) -> None:
    """Limits hold at both ends."""
    with pytest.raises(RobotDescriptionError, match=r"fov: .* is out of range"):
        parameters(fov=value).number("fov", 3.0, **limits)


def test_the_limits_are_told() -> None:
    """The cure says what range a number has."""
    with pytest.raises(RobotDescriptionError, match=r"greater than 0 and of at most 7, for"):
        parameters(fov=9).number("fov", 3.0, above=0.0, maximum=7.0)


@pytest.mark.parametrize("value", [2.0, "2", True, 11, -1])
def test_counts_are_whole_and_limited(value: object) -> None:
    """A count accepts neither fractions nor booleans nor values beyond its limits."""
    with pytest.raises(RobotDescriptionError, match="not a whole number from 0 to 10"):
        parameters(cones=value).count("cones", 2, minimum=0, maximum=10)


@pytest.mark.parametrize("value", [1, "true", 0.0])
def test_flags_are_booleans_only(value: object) -> None:
    """A flag accepts true and false, nothing that merely looks like it."""
    with pytest.raises(RobotDescriptionError, match=r"write literal = true or literal = false"):
        parameters(literal=value).flag("literal", False)


@pytest.mark.parametrize("value", ["world", 3, True])
def test_choices_list_their_words(value: object) -> None:
    """A word that is not known is answered with those that are."""
    with pytest.raises(RobotDescriptionError, match=r'write of = "robot" or "sensor"'):
        parameters(of=value).choice("of", "robot", ("robot", "sensor"))


def test_an_unread_key_is_refused_with_the_nearest_known_one() -> None:
    """A misspelt key names the key that was probably meant and lists all."""
    read = parameters(maxrange=20.0)
    read.number("max_range", 4.0)
    read.number("fov", 3.0)
    with pytest.raises(RobotDescriptionError) as error:
        read.finish()
    assert str(error.value) == (
        f"{PLACE}: maxrange: unknown key of a SICK (write max_range; known keys: fov, max_range)"
    )


def test_a_key_like_no_other_is_to_be_removed() -> None:
    """Without a near match the cure is to remove the key."""
    with pytest.raises(RobotDescriptionError, match=r"colour: unknown key .*\(remove it; known"):
        parameters(colour="red").finish()


def test_all_keys_read_is_fine() -> None:
    """Nothing is raised when every key was asked for, whatever the reader."""
    read = parameters(fov=3.0, wheel="left")
    read.number("fov", 1.0)
    read.raw("wheel")
    read.finish()


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_finite_number_passes_without_limits(value: float) -> None:
    """Numbers without limits come back unchanged."""
    assert parameters(fov=value).number("fov", 1.0) == value


@given(st.floats(min_value=-10, max_value=10))
def test_what_passes_is_within_the_limits(value: float) -> None:
    """A number is either returned unchanged and within its limits, or refused."""
    try:
        result = parameters(fov=value).number("fov", 1.0, above=0.0, maximum=7.0)
    except RobotDescriptionError:
        assert not 0.0 < value <= 7.0
    else:
        assert result == value
        assert 0.0 < value <= 7.0
