"""INIT, and the choice and facets of dialects, which begins with it (protocol reference 3.2, 5.2,
5.3, addendum; protocol 6.3, 6.11).
"""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol import messages
from usarsim_server.protocol.commands import interpret
from usarsim_server.protocol.dialects import (
    FACETS,
    UDK_ONLY_CLASSES,
    DialectMode,
    DialectSelector,
    range_digits,
    sends_results,
)
from usarsim_server.protocol.grammar import parse_line
from usarsim_server.protocol.requests import (
    GetConf,
    GetGeo,
    Init,
    Request,
)
from usarsim_server.protocol.values import Dialect, Vector

UT2004, UDK = Dialect.UT2004, Dialect.UDK

SIGNALS = [
    "INIT {Classname USARBot.P2AT}",
    "ACT {Name a} {Link 0} {Value 1}",
    *(
        f"{word} {{Type {wire_type}}}"
        for word in ("GETCONF", "GETGEO")
        for wire_type in ("Actuator", "gripper", "ToolChanger", "RangeImager", "OBJECTSENSOR")
    ),
    "INIT {ClassName USARBotAPI.WorldController}",
    "INIT {ClassName usaravatar.Worker}",
    "INIT {ClassName USARBot.KR60}",
    "INIT {ClassName kiva4wheel}",
    "INIT {ClassName USARBot.P2AT} {Dialect udk}",
]
NO_SIGNALS = [
    "INIT {ClassName USARBot.P2AT} {Name R1} {Location 1 2 3}",
    "INIT {ClassName USARBot.WorldController}",
    "GETSTARTPOSES",
    "GETCONF {Type RFID}",
    "GETGEO {Type MisPkg}",
    "GETCONF {Type Robot} {Name Actuator}",
    "SET {Type Gripper} {Opcode OPEN}",
    "MISPKG {Name a} {Link 1} {Value 1}",
    "DRIVE {Left 1} {Right 1}",
    "ACTOR {Name a}",
]


def request(line: str | bytes) -> Request:
    (command,) = parse_line(line.encode("latin-1") if isinstance(line, str) else line)
    return interpret(command)


def init(line: str) -> Init:
    found = request(line)
    assert isinstance(found, Init)
    return found


def test_before_anything_a_connection_speaks_ut2004() -> None:
    """Protocol 5.3: `auto` begins as `ut2004`."""
    assert DialectSelector().current is UT2004
    assert DialectSelector(DialectMode.AUTO).current is UT2004


def test_ports_are_configured_by_these_words() -> None:
    """Protocol 5.3: the three values are written auto, ut2004 and udk in settings."""
    assert [DialectMode(word) for word in ("auto", "ut2004", "udk")] == list(DialectMode)


@pytest.mark.parametrize("line", SIGNALS)
def test_each_signal_switches_to_udk(line: str) -> None:
    """Protocol 173, 175, 176: every habit of a UDK client switches."""
    selector = DialectSelector()
    selector.observe(request(line))
    assert selector.current is UDK


@pytest.mark.parametrize("line", NO_SIGNALS)
def test_nothing_else_switches(line: str) -> None:
    """Protocol 174: commands of UT2004 clients leave the dialect alone."""
    selector = DialectSelector()
    selector.observe(request(line))
    assert selector.current is UT2004


@pytest.mark.parametrize("class_default", list(Dialect))
def test_the_class_decides_the_default(class_default: Dialect) -> None:
    """Protocol 174 and addendum: under `auto` the era of the robot class is the default."""
    selector = DialectSelector()
    selector.initialised(class_default, init("INIT {ClassName USARBot.P3AT}"))
    assert selector.current is class_default


def test_classname_gives_udk_from_the_first_line() -> None:
    """Protocol 173: with `Classname` even a UT2004 class speaks `udk` at once."""
    selector = DialectSelector()
    selector.initialised(UT2004, init("INIT {Classname USARBot.P2AT}"))
    assert selector.current is UDK


def test_a_signal_before_init_outlives_a_ut2004_class() -> None:
    """Protocol 5.3: the change is made once and for good."""
    selector = DialectSelector()
    selector.observe(GetConf("Actuator"))
    selector.initialised(UT2004, init("INIT {ClassName USARBot.P2AT}"))
    assert selector.current is UDK


def test_a_signal_after_init_switches() -> None:
    """Protocol 175: `GETCONF {Type Actuator}` directly after INIT switches."""
    selector = DialectSelector()
    selector.initialised(UT2004, init("INIT {ClassName USARBot.P2AT}"))
    assert selector.current is UT2004
    selector.observe(GetConf("Actuator"))
    assert selector.current is UDK


def test_nothing_leads_back() -> None:
    """Protocol 5.3: no request switches from `udk` to `ut2004` except a forced dialect."""
    selector = DialectSelector()
    selector.observe(GetGeo("ObjectSensor"))
    for line in NO_SIGNALS:
        selector.observe(request(line))
    assert selector.current is UDK


@pytest.mark.parametrize("forced", list(Dialect))
@pytest.mark.parametrize("class_default", list(Dialect))
@pytest.mark.parametrize("line", SIGNALS)
def test_a_forced_dialect_stays(forced: Dialect, class_default: Dialect, line: str) -> None:
    """Protocol 176: `{Dialect x}` wins over class and spelling and disables automatic change."""
    selector = DialectSelector()
    selector.initialised(
        class_default, init(f"INIT {{Classname USARBot.KR60}} {{Dialect {forced.value}}}")
    )
    if "Dialect" not in line:
        selector.observe(request(line))
    assert selector.current is forced


def test_a_forced_dialect_wins_over_an_earlier_signal() -> None:
    """Protocol 176: whoever states a dialect gets it, whatever was seen before."""
    selector = DialectSelector()
    selector.observe(GetConf("Actuator"))
    selector.initialised(UDK, init("INIT {ClassName P3AT} {Dialect ut2004}"))
    assert selector.current is UT2004


@pytest.mark.parametrize("mode", [DialectMode.UT2004, DialectMode.UDK])
@pytest.mark.parametrize("class_default", list(Dialect))
def test_a_fixed_port_never_changes(mode: DialectMode, class_default: Dialect) -> None:
    """Protocol 177: neither class, nor signal, nor `{Dialect x}` changes a fixed port."""
    selector = DialectSelector(mode)
    expected = Dialect(mode.value)
    assert selector.current is expected
    for line in SIGNALS:
        selector.observe(request(line))
    for dialect in Dialect:
        forced = init(f"INIT {{Classname KR60}} {{Dialect {dialect.value}}}")
        selector.initialised(class_default, forced)
        assert selector.current is expected


def test_selectors_share_nothing() -> None:
    """Protocol 178: two connections choose for themselves."""
    one, other = DialectSelector(), DialectSelector()
    one.observe(GetConf("Actuator"))
    assert (one.current, other.current) == (UDK, UT2004)


def test_observing_init_twice_changes_nothing() -> None:
    """`initialised` may follow an `observe` of the same request."""
    selector = DialectSelector()
    line = init("INIT {ClassName P3AT}")
    selector.observe(line)
    selector.initialised(UDK, line)
    selector.initialised(UDK, line)
    assert selector.current is UDK


@given(st.lists(st.sampled_from(SIGNALS + NO_SIGNALS), max_size=12), st.sampled_from(Dialect))
def test_one_signal_anywhere_decides(lines: list[str], class_default: Dialect) -> None:
    """Protocol 5.3 and addendum: in any order of requests, `udk` results from a signal or from the
    class."""
    selector = DialectSelector()
    for line in lines:
        selector.observe(request(line))
    selector.initialised(class_default, init("INIT {ClassName P2AT}"))
    signalled = any(line in SIGNALS for line in lines)
    assert selector.current is (UDK if signalled else class_default)


def test_udk_only_classes_are_lower_case() -> None:
    """Protocol 5.3 signal 4: the seventeen classes, spelled for comparison without case; P3AT is
    none."""
    assert len(UDK_ONLY_CLASSES) == 17
    assert all(name == name.lower() for name in UDK_ONLY_CLASSES)
    assert "p3at" not in UDK_ONLY_CLASSES


def test_facets_of_the_table() -> None:
    """Protocol 5.3: the rows of the dialect table, left column and right column."""
    assert (sends_results(UT2004), sends_results(UDK)) == (True, False)
    rows = {
        field.name: (getattr(FACETS[UT2004], field.name), getattr(FACETS[UDK], field.name))
        for field in dataclasses.fields(FACETS[UT2004])
    }
    assert rows["sta_period"] == (0.2, 0.1)
    assert rows["partial_drive"] == (True, False)
    assert rows["sticky_normalized"] == (False, True)
    assert rows["time_digits"] == (2, 4)
    assert rows["geometry_digits"] == (4, 2)
    assert rows["batched_geometry"] == (True, False)
    assert rows["type_before_name"] == (True, False)
    assert rows["multi_pair"] == (True, False)
    assert rows["mission_package_head"] == ("MISSTA", "ASTA")
    assert rows["camera_in_degrees"] == (False, True)
    assert rows["ground_truth_signed"] == (False, True)
    assert rows["ground_truth_digits"] == (2, 3)
    assert rows["encoder_wraps"] == (False, True)
    assert rows["panning_key"] == ("Paning", "Panning")
    assert all(left != right for left, right in rows.values())


def test_rotational_velocity_units() -> None:
    """Protocol 152: 90 in `udk` and 1.5708 in `ut2004` are the same quarter turn per second."""
    quarter = math.pi / 2
    assert 90 * FACETS[UDK].rotational_velocity_unit == pytest.approx(quarter)
    assert quarter * FACETS[UT2004].rotational_velocity_unit == pytest.approx(quarter)


@pytest.mark.parametrize(
    ("dialect", "beams", "digits"),
    [(UT2004, 181, 4), (UT2004, 240, 4), (UT2004, 241, 2), (UT2004, 1081, 2), (UDK, 5, 2)],
)
def test_range_digits(dialect: Dialect, beams: int, digits: int) -> None:
    """Protocol 106 and 5.2 no. 14: four digits only in `ut2004` and only up to 240 beams."""
    assert range_digits(dialect, beams) == digits


def test_dialects_differ_in_one_place() -> None:
    """What they differ in is a facet, or a matter of `messages`: nobody else asks which it is."""
    package = Path(messages.__file__).parents[2]
    compared = re.compile(
        r"\bis (not )?Dialect\.|[!=]= *Dialect\.|\bDialect\.\w+ *(is|==|!=|in) |case Dialect\."
    )
    own = {package / "protocol" / "dialects.py", *Path(messages.__file__).parent.glob("*.py")}
    guilty = [
        f"{path.relative_to(package)}: {line.strip()}"
        for path in sorted(set(package.rglob("*.py")) - own)
        for line in path.read_text(encoding="utf-8").splitlines()
        if compared.search(line)
    ]
    assert guilty == []


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (
            "INIT {ClassName USARBot.P2DX} {Location 4.5,1.9,1.8}",
            ("P2DX", None, (4.5, 1.9, 1.8), None, None),
        ),
        (
            "INIT {ClassName USARBot.P3AT} {Name Rover7} {Location -2.25,0.80,-0.35} "
            "{Rotation 0,0,1.5708}",
            ("P3AT", "Rover7", (-2.25, 0.8, -0.35), (0, 0, 1.5708), None),
        ),
        (
            "INIT {Classname USARBot.P3AT} {Name rover} {Start RobotStart1}",
            ("P3AT", "rover", None, None, "RobotStart1"),
        ),
        (
            "INIT {ClassName USARBot.P2AT} {Name R1} {Location 1.000000 -2.000000 1.800000} "
            "{Rotation 0.000000 0.000000 0.000000}",
            ("P2AT", "R1", (1, -2, 1.8), (0, 0, 0), None),
        ),
        (
            "INIT {ClassName USARBot.P2AT}{Name R2}{Location 0, -50, 020}",
            ("P2AT", "R2", (0, -50, 20), None, None),
        ),
        (
            "INIT {ClassName USARBotAPI.WorldController} {Name WC} {Location 0,0,0}",
            ("WorldController", "WC", (0, 0, 0), None, None),
        ),
    ],
)
def test_init_examples(
    line: str, expected: tuple[str, str | None, Vector | None, Vector | None, str | None]
) -> None:
    """Protocol 3.2: all documented forms of INIT give class, name, location, rotation and start."""
    found = init(line)
    assert (found.class_name, found.name, found.location, found.rotation, found.start) == expected


@pytest.mark.parametrize(
    ("text", "package", "class_name"),
    [
        ("USARBot.P2AT", "USARBot", "P2AT"),
        ("P2AT", "", "P2AT"),
        ("usarbot.p2at", "usarbot", "p2at"),
        ("A.B.P2AT", "A.B", "P2AT"),
        ("USARBot. P2AT", "USARBot", "P2AT"),
        ("USARBot.", "USARBot", ""),
        ("", "", ""),
    ],
)
def test_init_class_with_and_without_package(text: str, package: str, class_name: str) -> None:
    """Protocol 72: the class is what follows the last point, the package what precedes it."""
    found = init(f"INIT {{ClassName {text}}}")
    assert (found.package, found.class_name) == (package, class_name)


@pytest.mark.parametrize(
    ("key", "exact"),
    [("ClassName", False), ("Classname", True), ("classname", False), ("CLASSNAME", False)],
)
def test_init_notices_the_spelling_of_the_ros_family(key: str, exact: bool) -> None:
    """Protocol 73, 173: every case of ClassName is accepted and only `Classname` is told apart."""
    found = init(f"INIT {{{key} USARBot.P3AT}}")
    assert found.class_name == "P3AT"
    assert found.spelled_classname_exactly is exact


def test_init_without_anything() -> None:
    """Protocol 74, 75: name, place and class may be missing; missing and empty are the same."""
    assert init("INIT") == Init(class_name="")
    found = init("INIT {ClassName P2AT} {Name} {Location} {Rotation } {Start} {Skin}")
    assert (found.name, found.location, found.rotation, found.start, found.skin) == (None,) * 5


def test_init_extras() -> None:
    """Protocol 78: Battery, Team, Skin are read, unknown segments are kept and harmless."""
    found = init("INIT {ClassName P2AT} {Battery 600} {Team 2} {Skin red.blue} {Foo bar}")
    assert (found.battery, found.team, found.skin) == (600.0, 2, "red.blue")
    assert found.segments[-1] == ("Foo", "bar")
    assert init("INIT {ClassName P2AT}").battery is None


@pytest.mark.parametrize(
    ("value", "dialect"),
    [
        ("udk", Dialect.UDK),
        ("UT2004", Dialect.UT2004),
        ("auto", None),
        ("gazebo", None),
        ("", None),
    ],
)
def test_init_dialect(value: str, dialect: Dialect | None) -> None:
    """Protocol 176: `{Dialect x}` is read in any case; anything else forces nothing."""
    assert init(f"INIT {{ClassName P2AT}} {{Dialect {value}}}").dialect is dialect


@pytest.mark.parametrize(
    ("text", "location"),
    [
        ("1,2,3", (1, 2, 3)),
        ("1, 2, 3", (1, 2, 3)),
        ("1.0 2.0 3.0", (1, 2, 3)),
        (" 1,2,3 ", (1, 2, 3)),
        (".4, .4, 1.8", (0.4, 0.4, 1.8)),
        ("0, -50, 020", (0, -50, 20)),
        ("0,5 1,0 1,8", (0.5, 1.0, 1.8)),
        ("1,2", (1, 2, 0)),
        ("0,0000, 0,0000, 0,0000", (0, 0, 0)),
    ],
)
def test_init_locations(text: str, location: Vector) -> None:
    """Protocol 47 to 51 and addendum: every spelling of a location spawns at the same place."""
    assert init(f"INIT {{ClassName P2AT}} {{Location {text}}}").location == location


def test_init_with_foreign_name() -> None:
    """Protocol 52: non-ASCII bytes in a name leave the later segments readable."""
    found = request("INIT {ClassName P2AT} {Name Žluť} {Location 1,2,3}".encode())
    assert isinstance(found, Init)
    assert found.location == (1, 2, 3)
