"""Choice and facets of dialects (protocol reference 5.2, 5.3, addendum; checklist 6.11)."""

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
from usarsim_server.protocol.requests import GetConf, GetGeo, Init, Request
from usarsim_server.protocol.values import Dialect

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


def request(line: str) -> Request:
    (command,) = parse_line(line.encode())
    return interpret(command)


def init(line: str) -> Init:
    found = request(line)
    assert isinstance(found, Init)
    return found


def test_before_anything_a_connection_speaks_ut2004() -> None:
    """5.3: `auto` begins as `ut2004`."""
    assert DialectSelector().current is UT2004
    assert DialectSelector(DialectMode.AUTO).current is UT2004


def test_ports_are_configured_by_these_words() -> None:
    """5.3: the three values are written auto, ut2004 and udk in settings."""
    assert [DialectMode(word) for word in ("auto", "ut2004", "udk")] == list(DialectMode)


@pytest.mark.parametrize("line", SIGNALS)
def test_each_signal_switches_to_udk(line: str) -> None:
    """173, 175, 176: every habit of a UDK client switches."""
    selector = DialectSelector()
    selector.observe(request(line))
    assert selector.current is UDK


@pytest.mark.parametrize("line", NO_SIGNALS)
def test_nothing_else_switches(line: str) -> None:
    """174: commands of UT2004 clients leave the dialect alone."""
    selector = DialectSelector()
    selector.observe(request(line))
    assert selector.current is UT2004


@pytest.mark.parametrize("class_default", list(Dialect))
def test_the_class_decides_the_default(class_default: Dialect) -> None:
    """174 and addendum: under `auto` the era of the robot class is the default."""
    selector = DialectSelector()
    selector.initialised(class_default, init("INIT {ClassName USARBot.P3AT}"))
    assert selector.current is class_default


def test_classname_gives_udk_from_the_first_line() -> None:
    """173: with `Classname` even a UT2004 class speaks `udk` at once."""
    selector = DialectSelector()
    selector.initialised(UT2004, init("INIT {Classname USARBot.P2AT}"))
    assert selector.current is UDK


def test_a_signal_before_init_outlives_a_ut2004_class() -> None:
    """5.3: the change is made once and for good."""
    selector = DialectSelector()
    selector.observe(GetConf("Actuator"))
    selector.initialised(UT2004, init("INIT {ClassName USARBot.P2AT}"))
    assert selector.current is UDK


def test_a_signal_after_init_switches() -> None:
    """175: `GETCONF {Type Actuator}` directly after INIT switches."""
    selector = DialectSelector()
    selector.initialised(UT2004, init("INIT {ClassName USARBot.P2AT}"))
    assert selector.current is UT2004
    selector.observe(GetConf("Actuator"))
    assert selector.current is UDK


def test_nothing_leads_back() -> None:
    """5.3: no request switches from `udk` to `ut2004` except a forced dialect."""
    selector = DialectSelector()
    selector.observe(GetGeo("ObjectSensor"))
    for line in NO_SIGNALS:
        selector.observe(request(line))
    assert selector.current is UDK


@pytest.mark.parametrize("forced", list(Dialect))
@pytest.mark.parametrize("class_default", list(Dialect))
@pytest.mark.parametrize("line", SIGNALS)
def test_a_forced_dialect_stays(forced: Dialect, class_default: Dialect, line: str) -> None:
    """176: `{Dialect x}` wins over class and spelling and disables automatic change."""
    selector = DialectSelector()
    selector.initialised(
        class_default, init(f"INIT {{Classname USARBot.KR60}} {{Dialect {forced.value}}}")
    )
    if "Dialect" not in line:
        selector.observe(request(line))
    assert selector.current is forced


def test_a_forced_dialect_wins_over_an_earlier_signal() -> None:
    """176: whoever states a dialect gets it, whatever was seen before."""
    selector = DialectSelector()
    selector.observe(GetConf("Actuator"))
    selector.initialised(UDK, init("INIT {ClassName P3AT} {Dialect ut2004}"))
    assert selector.current is UT2004


@pytest.mark.parametrize("mode", [DialectMode.UT2004, DialectMode.UDK])
@pytest.mark.parametrize("class_default", list(Dialect))
def test_a_fixed_port_never_changes(mode: DialectMode, class_default: Dialect) -> None:
    """177: neither class, nor signal, nor `{Dialect x}` changes a fixed port."""
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
    """178: two connections choose for themselves."""
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
    """5.3 and addendum: in any order of requests, `udk` results from a signal or from the class."""
    selector = DialectSelector()
    for line in lines:
        selector.observe(request(line))
    selector.initialised(class_default, init("INIT {ClassName P2AT}"))
    signalled = any(line in SIGNALS for line in lines)
    assert selector.current is (UDK if signalled else class_default)


def test_udk_only_classes_are_lower_case() -> None:
    """5.3 signal 4: the seventeen classes, spelled for comparison without case; P3AT is none."""
    assert len(UDK_ONLY_CLASSES) == 17
    assert all(name == name.lower() for name in UDK_ONLY_CLASSES)
    assert "p3at" not in UDK_ONLY_CLASSES


def test_facets_of_the_table() -> None:
    """5.3: the rows of the dialect table, left column and right column."""
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
    """152: 90 in `udk` and 1.5708 in `ut2004` are the same quarter turn per second."""
    quarter = math.pi / 2
    assert 90 * FACETS[UDK].rotational_velocity_unit == pytest.approx(quarter)
    assert quarter * FACETS[UT2004].rotational_velocity_unit == pytest.approx(quarter)


@pytest.mark.parametrize(
    ("dialect", "beams", "digits"),
    [(UT2004, 181, 4), (UT2004, 240, 4), (UT2004, 241, 2), (UT2004, 1081, 2), (UDK, 5, 2)],
)
def test_range_digits(dialect: Dialect, beams: int, digits: int) -> None:
    """106 and 5.2 no. 14: four digits only in `ut2004` and only up to 240 beams."""
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
