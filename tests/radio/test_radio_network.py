"""Stations, links and strengths as robots move; fading, shaping, the record, the settings."""

from __future__ import annotations

import math
import statistics
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from radio_fakes import Field, model, rows

from usarsim_server.base.errors import SettingsError
from usarsim_server.radio.configuration import (
    Fading,
    LinkClock,
    LinkShape,
    read_radio,
    read_radio_file,
)
from usarsim_server.radio.event_log import Event, EventLog
from usarsim_server.radio.network import Departure, Network

SIX = (1, 2, 3, 4, 5, 6)


def network(field: Field, name: str = "obstacle", **options: object) -> Network:
    """A network of all stations of a field, which it has looked at."""
    made = Network(field.world(), model(name), **options)  # type: ignore[arg-type]
    for station in field.places:
        assert made.register(station, 0.0)
    made.observe()
    return made


class TestStrengths:
    def test_strength_follows_the_stations(self) -> None:
        """What was seen last decides; the strength is the same in both directions
        (side channels 78)."""
        field = Field(A=0, B=10)
        made = network(field)
        assert round(made.strength("A", "B"), 4) == -56.6597
        field.put("B", 100)
        assert round(made.strength("B", "A"), 4) == -56.6597
        made.observe()
        assert round(made.strength("B", "A"), 4) == -66.6597
        assert made.distance("A", "B") == 100.0

    def test_walls_end_a_link(self) -> None:
        """Six obstacles at 10 m take the link down, five do not (side channels 78)."""
        assert network(Field(*SIX[:5], A=0, B=10)).connected("A", "B")
        assert not network(Field(*SIX, A=0, B=10)).connected("A", "B")

    def test_unknown_stations(self) -> None:
        """Unknown places: no strength; only the trusting model links (side channels 4.4)."""
        for name, linked in (("distance", True), ("obstacle", False), ("none", True)):
            made = network(Field(A=0), name)
            made.register("Ghost", 0.0)
            made.observe()
            assert made.connected("A", "Ghost") is linked
            assert math.isnan(made.strength("A", "Ghost")) is (name != "none")

    def test_obstacles_are_counted_when_somebody_moved(self) -> None:
        """A short way costs no new count, a longer one does (side channels 3.5)."""
        field = Field(5, A=0, B=4)
        made = network(field, cache_distance=1.0)
        for place, walls, counts in ((4.9, 0, 1), (5.1, 1, 2), (5.9, 1, 2)):
            field.put("B", place)
            made.observe()
            assert made.strength("A", "B") == pytest.approx(
                model().strength(place, walls), abs=1e-9
            )
            assert field.walls.asked == counts

    def test_a_newcomer_of_an_old_name_is_counted_anew(self) -> None:
        """Counts of a station that left are forgotten with it."""
        field = Field(5, A=0, B=4.99)
        made = network(field, cache_distance=1.0)
        made.deregister("B")
        field.put("B", 5.01)
        made.register("B", 0.0)
        made.observe()
        assert made.strength("A", "B") == pytest.approx(model().strength(5.01, 1))


class TestStations:
    def test_names_are_unique(self) -> None:
        """A name is taken until its owner leaves; case makes names different (side channels 70)."""
        made = network(Field(A=0))
        assert not made.register("A", 0.0)
        assert made.register("a", 0.0)
        made.deregister("A")
        made.deregister("A")
        assert made.register("A", 0.0)
        assert made.names == ("a", "A")

    def test_who_is_missing_has_to_go(self) -> None:
        """Only after the patience, and only one that the simulator does not know
        (side channels 76)."""
        field = Field(A=0, B=1)
        made = network(field, patience=1.0)
        del field.places["B"]
        made.observe()
        assert made.review(0.9) == []
        assert made.review(1.1) == [Departure("B", battery_empty=False)]

    def test_patience_begins_when_a_station_was_last_seen(self) -> None:
        """A station that is back in time stays."""
        field = Field(A=0, B=1)
        made = network(field, patience=1.0)
        made.review(10.0)
        del field.places["B"]
        made.observe()
        assert made.review(10.9) == []
        field.put("B", 1)
        made.observe()
        assert made.review(11.5) == []

    def test_an_empty_battery_ends_it_at_once(self) -> None:
        """A station without power has to go (side channels 4.4)."""
        field = Field(A=0, B=1)
        made = network(field)
        field.empty.add("A")
        made.observe()
        assert made.review(0.0) == [Departure("A", battery_empty=True)]

    def test_without_propagation_nobody_has_to_be_there(self) -> None:
        """The model `none` asks nobody and drops nobody (side channels 4.4)."""
        field = Field()
        made = network(field, "none")
        made.register("A", 0.0)
        made.register("B", 0.0)
        assert made.review(1e6) == []
        assert made.strength("A", "B") == 0.0


class TestRecord:
    def test_links_are_recorded_when_they_change(self, tmp_path: Path) -> None:
        """IN_RANGE and OUT_OF_RANGE with names in order, strength, distance (side channels 4.6)."""
        field = Field(*SIX, B=0, A=0.5)
        file = tmp_path / "events.csv"
        log = EventLog(file, lambda: field.time)
        made = network(field, log=log)
        for field.time, place in ((1.0, 0.5), (2.0, 0.6), (3.0, 10), (4.0, 0.5)):
            field.put("A", place)
            made.observe()
            made.review(0.0)
        log.close()
        assert rows(file) == [
            ["IN_RANGE", "A", "B", "-43.6494", "0.5", "1.000"],
            ["OUT_OF_RANGE", "A", "B", "-94.6097", "10", "3.000"],
            ["IN_RANGE", "A", "B", "-43.6494", "0.5", "4.000"],
        ]

    def test_names_cannot_break_lines(self, tmp_path: Path) -> None:
        """Names with commas and quotes are quoted."""
        file = tmp_path / "events.csv"
        log = EventLog(file, lambda: 0.0)
        log.write(Event.DEREGISTERED, 'a,"b"')
        log.close()
        log.write(Event.DEREGISTERED, "late")
        assert file.read_text().startswith("DEREGISTERED,")
        assert '"a,""b""",0.000' in file.read_text()
        assert len(file.read_text().splitlines()) == 1

    def test_a_folder_gets_a_file_like_that_of_the_original(self, tmp_path: Path) -> None:
        """Named log-<yyyy.MM.dd-hh.mm.ss.zzz>.txt (side channels 4.6)."""
        EventLog(tmp_path, lambda: 0.0).close()
        (file,) = tmp_path.iterdir()
        parts = file.stem.removeprefix("log-").replace("-", ".").split(".")
        assert file.suffix == ".txt"
        assert [len(part) for part in parts] == [4, 2, 2, 2, 2, 2, 3]

    def test_a_file_that_cannot_be_written(self, tmp_path: Path) -> None:
        """It is one error that names the file."""
        with pytest.raises(SettingsError, match=r"no/such\.csv: cannot be written"):
            EventLog(tmp_path / "no" / "such.csv", lambda: 0.0)


class TestFading:
    def test_values_are_normal(self) -> None:
        """Mean 0 and the deviation asked for, over many intervals."""
        fading = Fading(4.0, 1.0, seed=3)
        values = [fading.of("A", "B", float(time)) for time in range(4000)]
        assert statistics.mean(values) == pytest.approx(0.0, abs=0.25)
        assert statistics.stdev(values) == pytest.approx(4.0, rel=0.05)
        inside = sum(abs(value) < 4.0 for value in values) / len(values)
        assert inside == pytest.approx(0.683, abs=0.025)

    @given(st.text(max_size=9), st.text(max_size=9), st.floats(0, 1e6), st.integers(0, 2**62))
    def test_values_repeat(self, one: str, other: str, time: float, seed: int) -> None:
        """Seed, pair and interval decide alone; both directions are equal."""
        fading = Fading(2.0, 0.5, seed)
        value = fading.of(one, other, time)
        assert math.isfinite(value)
        assert Fading(2.0, 0.5, seed).of(other, one, math.floor(time / 0.5) * 0.5) == value

    def test_everything_matters(self) -> None:
        """Another seed, pair or interval gives another value."""
        values = {
            Fading(1.0, 1.0, seed).of("A", name, time)
            for seed in (0, 1)
            for name in ("B", "C")
            for time in (0.0, 1.0)
        }
        assert len(values) == 8

    def test_networks_fade(self) -> None:
        """Fading is added to the strength, and can cut a link."""
        field = Field(A=0, B=10)
        fading = Fading(30.0, 1.0, seed=1)
        made = network(field, fading=fading)
        links = set()
        for field.time in range(40):
            made.observe()
            expected = model().strength(10, 0) + fading.of("A", "B", field.time)
            assert made.strength("A", "B") == pytest.approx(expected)
            links.add(made.connected("A", "B"))
        assert links == {True, False}


class TestShaping:
    def test_latency_and_bandwidth(self) -> None:
        """Blocks queue for the air and arrive a latency later."""
        clock = LinkClock(LinkShape(latency=0.5, bandwidth=1000.0), "x")
        assert clock.arrival(10.0, 100) == pytest.approx(10.6)
        assert clock.arrival(10.0, 100) == pytest.approx(10.7)
        assert clock.arrival(20.0, 0) == pytest.approx(20.5)

    def test_lost_frames_come_later(self) -> None:
        """The mean delay is that of p / (1 - p) repetitions; equal seeds lose equal frames."""
        shape = LinkShape(loss=0.2, retry_delay=1.0)

        def delays(seed: str) -> list[float]:
            clock = LinkClock(shape, seed)
            return [clock.arrival(1e4 * n, 1000) - 1e4 * n for n in range(4000)]

        assert statistics.mean(delays("x")) == pytest.approx(0.25, rel=0.1)
        assert delays("x") == delays("x")
        assert delays("x") != delays("y")

    @given(st.lists(st.tuples(st.floats(0, 5), st.integers(0, 9000)), max_size=30))
    def test_blocks_do_not_overtake(self, blocks: list[tuple[float, int]]) -> None:
        """Arrivals are in the order of departure, none before its time."""
        clock = LinkClock(LinkShape(0.1, 5000.0, 0.3), "x")
        now, last = 0.0, 0.0
        for pause, size in blocks:
            now += pause
            arrival = clock.arrival(now, size)
            assert arrival >= max(last, now + 0.1)
            last = arrival


class TestSettings:
    def test_everything_can_be_set(self) -> None:
        """Keys of model, fading, links and network stand in one table; hyphens are fine."""
        table = {
            "model": "path-loss",
            "preset": "bahl",
            "cutoff": -80,
            "fading": 2,
            "fading-interval": 0.5,
            "seed": 7,
            "latency": 0.1,
            "bandwidth": 1e5,
            "loss": 0.01,
            "retry_delay": 0.05,
            "poll": 0.1,
            "patience": 5,
            "cache_distance": 0.5,
        }
        options = read_radio(table, "here")
        assert options.model.cutoff == -80
        assert options.fading == Fading(2.0, 0.5, 7)
        assert options.shape == LinkShape(0.1, 1e5, 0.01, 0.05)
        assert (options.poll, options.patience, options.cache_distance) == (0.1, 5.0, 0.5)

    def test_defaults(self) -> None:
        """The obstacle model without fading on plain links, the seed of the server."""
        options = read_radio({}, "here", seed=5)
        assert type(options.model) is type(model("obstacle"))
        assert options.shape.plain
        assert options.fading == Fading(0.0, 1.0, 5)

    def test_the_command_line_wins(self) -> None:
        """A model named outside replaces that of the table, and its errors name the option."""
        assert type(read_radio({"model": "none"}, "x", "distance").model) is type(model("distance"))
        with pytest.raises(SettingsError, match=r"^--wireless-model: unknown propagation model"):
            read_radio({}, "x", "telepathy")

    @pytest.mark.parametrize(
        ("table", "words"),
        [
            ({"model": 3}, "here: model: 3 is not text"),
            ({"model": "x"}, "here: model: unknown propagation model 'x'"),
            ({"loss": 1.0}, "here: loss: 1.0 is out of range"),
            ({"seed": 1.5}, "here: seed: 1.5 is not a whole number"),
            (
                {"latncy": 1},
                "latncy: unknown key of the wireless simulation (did you mean latency",
            ),
        ],
    )
    def test_mistakes_are_told(self, table: dict[str, object], words: str) -> None:
        """Wrong keys and values are one error each, with place and cure."""
        with pytest.raises(SettingsError) as caught:
            read_radio(table, "here")
        assert words in str(caught.value)

    def test_files(self, tmp_path: Path) -> None:
        """A file holds the bare keys or a [wireless] table; what cannot be read is told."""
        file = tmp_path / "radio.toml"
        for text in ('model = "none"\n', '[wireless]\nmodel = "none"\n'):
            file.write_text(text)
            assert read_radio_file(file) == {"model": "none"}
        file.write_text("model = ")
        with pytest.raises(SettingsError, match=r"radio\.toml: end of document: is not valid TOML"):
            read_radio_file(file)
        with pytest.raises(SettingsError, match=r"gone\.toml: cannot be read"):
            read_radio_file(tmp_path / "gone.toml")


def test_names_of_nobody_cost_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Any number of them may be registered: no link of theirs is worked out, nothing is counted."""
    field = Field(A=0, B=10)
    made = network(field)
    for number in range(250):
        made.register(f"N{number}", 0.0)
    counted, asked = field.walls.asked, 0
    strength = made.strength

    def counting(one: str, other: str) -> float:
        nonlocal asked
        asked += 1
        return strength(one, other)

    monkeypatch.setattr(made, "strength", counting)
    made.observe()
    assert len(made.review(0.0)) == 0
    assert (asked, field.walls.asked) == (0, counted)
