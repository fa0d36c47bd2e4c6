"""Messages: their size, and links with a bandwidth, a latency and loss."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from usarsim_exploration.cycle import Cycle, Member, set_up
from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.known_map import AT_BASE, FREE, KNOWN, RELAYED
from usarsim_exploration.messages import HEAD, letter_size, map_size
from usarsim_exploration.radio import Circle, Radio, SubT
from usarsim_exploration.strategies.nearest import Nearest
from usarsim_exploration.strategy import Plan, Strategy, View


class Still(Strategy):
    """Stays where it is."""

    def decide(self, view: View) -> Plan | None:
        """Nothing."""
        return None


def hall(
    radio: Radio, starts: list[Cell], reach: float, strategy: Strategy | None = None, seed: int = 1
) -> Cycle:
    """A long room with pillars; the base at the first start."""
    walls = np.zeros((30, 120), np.uint8)
    walls[[0, -1]] = walls[:, [0, -1]] = walls[8:22:6, 10::12] = 1
    team = [Member("base", "base", starts[0], reach=0, radio_range=reach)]
    team += [
        Member(f"r{number}", "explorer", cell, reach=25, radio_range=reach)
        for number, cell in enumerate(starts[1:], 1)
    ]
    return set_up(Environment("hall", walls), team, strategy or Still(), radio, seed)


def told(cycle: Cycle, number: int) -> NDArray[np.uint8]:
    """What a robot knows, without whom it takes for a carrier."""
    return cycle.bodies[number].view.known.bits & ~np.uint8(RELAYED)


def write(cells: list[int], bits: list[int]) -> bytes:
    """Runs as messages have them."""
    runs: list[list[int]] = []
    for cell, value in zip(cells, bits, strict=True):
        if runs and runs[-1][0] + runs[-1][2] == cell and runs[-1][1] == value:
            runs[-1][2] += 1
        else:
            runs.append([cell, value, 1])
    return b"".join(struct.pack("<IH", cell << 5 | value, count) for cell, value, count in runs)


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.integers(0, 2000), st.integers(1, 31), max_size=80))
def test_a_map_is_as_large_as_its_runs(cells: dict[int, int]) -> None:
    """EXP-09: bytes are those of runs that can be read again."""
    places = sorted(cells)
    bits = [cells[place] for place in places]
    data = write(places, bits)
    assert map_size(np.array(places, np.int64), np.array(bits, np.uint8)) == len(data)
    read = {}
    for head, count in struct.iter_unpack("<IH", data):
        read.update(dict.fromkeys(range(head >> 5, (head >> 5) + count), head & 31))
    assert read == cells


def test_letters_count() -> None:
    """Texts by their length, cells as runs."""
    assert letter_size({}) == 0
    assert letter_size({"a": (1, 2)}) == 7
    assert letter_size({"a": np.array([4, 5, 9])}) == 1 + 2 * 6


def test_difference_is_a_fifth_of_whole_maps() -> None:
    """EXP-10: after contact both hold the union; what is new costs little."""
    cycle = hall(Circle(), [(5, 15), (7, 15), (7, 17)], 60.0, Nearest())
    whole = 0
    for _ in range(60):
        cycle.advance()
        for group in cycle.links.groups():
            assert all((told(cycle, one) == told(cycle, group[0])).all() for one in group)
            for number in group:
                bits = told(cycle, number).reshape(-1)
                cells = np.flatnonzero(bits)
                whole += map_size(cells, bits[cells]) * (len(group) - 1)
    assert 0 < cycle.bytes_sent <= 0.2 * whole


def test_each_hears_once_what_is_news_to_it() -> None:
    """EXP-10: what each of three found out by itself goes to both others at once; after that, as
    nobody moves, each message is a head."""
    starts = [(5, 15), (45, 15), (85, 15)]
    apart, linked = (hall(Circle(), starts, reach) for reach in (1.0, 60.0))
    assert apart.cells_sent == apart.bytes_sent == 0
    own = [body.view.known.bits.reshape(-1) for body in apart.bodies]
    found = [np.flatnonzero(bits) for bits in own]
    assert min(map(len, found[1:])) > 100
    sizes = [map_size(cells, bits[cells]) for cells, bits in zip(found, own, strict=True)]
    for heads in (1, 2, 3):
        assert linked.cells_sent == 2 * sum(map(len, found))
        assert linked.bytes_sent == 2 * sum(heads * HEAD + size for size in sizes)
        linked.advance()
    for body in linked.bodies:
        others = {0, 1, 2} - {body.view.number}
        assert body.view.linked == set(body.view.teammates) == others
        assert {one.heard for one in body.view.teammates.values()} == {linked.step}


@pytest.mark.parametrize("radio", [Circle(bandwidth=300), SubT(bandwidth=500)])
def test_no_radio_sends_more_than_its_bandwidth(radio: Radio) -> None:
    """EXP-09: in no step; and in the end everybody knows what anybody does, the base as well."""
    cycle = hall(radio, [(5, 15), (20, 15), (35, 15)], 18.0)
    most = 0
    for _ in range(60):
        before = cycle.bytes_sent
        cycle.advance()
        assert cycle.messages.sent.max() <= radio.bandwidth
        assert cycle.bytes_sent - before == cycle.messages.sent.sum()
        most = max(most, int(cycle.messages.sent.max()))
    assert most > 0.9 * radio.bandwidth
    known = told(cycle, 0)
    for number in (1, 2):
        other = told(cycle, number)
        assert ((other & KNOWN == 0) == (known & KNOWN == 0)).all()
        # who takes a cell for free and who for a wall, neither for certain, both stay with it
        assert np.count_nonzero(other != known) < 0.02 * np.count_nonzero(known)
    free = known & FREE != 0
    assert free.sum() > 500
    assert (known[free] & AT_BASE != 0).all()


def test_a_narrow_link_takes_longer() -> None:
    """EXP-09: the base knows less at any time than over a wide one."""
    known = {}
    for bandwidth in (0, 100):
        cycle = hall(Circle(bandwidth=bandwidth), [(5, 15), (20, 15)], 18.0)
        cycle.advance()
        known[bandwidth] = cycle.bodies[0].view.known.free
    assert 0 < known[100] < 0.6 * known[0]


def test_news_take_their_time_over_each_hop() -> None:
    """E-74: after the latency, a hop farther after as much again and a step."""
    cycle = hall(Circle(latency=4), [(5, 15), (20, 15), (35, 15)], 18.0)
    heard: dict[int, int] = {}
    for _ in range(12):
        cycle.advance()
        for number in (0, 1):
            mates = cycle.bodies[number].view.teammates
            if mates[2].heard >= 0:
                heard.setdefault(number, cycle.step)
    assert heard == {1: 4, 0: 9}  # written at steps 0 and 5, after reading
    assert cycle.bodies[2].base_step == 12 - 9
    assert cycle.bodies[2].view.linked == {0, 1}


def test_what_gets_lost_is_sent_again_and_repeats() -> None:
    """EXP-09, E-20: the same frames get lost under the same seed, and all arrives in the end."""
    runs = []
    for seed in (1, 1, 2):
        cycle = hall(Circle(loss=0.6), [(5, 15), (20, 15)], 18.0, seed=seed)
        sizes = []
        for _ in range(40):
            cycle.advance()
            sizes.append(cycle.bytes_sent)
        assert (told(cycle, 0) & KNOWN == told(cycle, 1) & KNOWN).all()
        runs.append(sizes)
    assert runs[0] == runs[1] != runs[2]


def test_frames_get_lost_towards_the_end_of_a_link() -> None:
    """SubT-like: hardly any nearby, half of them where the link ends, walls as far away."""
    radio = SubT()
    away = np.arange(1.0, 3000.0)
    losses = np.array([radio.frame_loss(one, 0.0, 0, 0.1) for one in away])
    assert (np.diff(losses) >= 0).all()
    last = int(np.count_nonzero([radio.hears(one, 0.0, 0, 0.1) for one in away]))
    assert losses[last // 2] < 1e-6
    assert 0.4 < losses[last - 1] <= 0.5 < losses[last]
    walled = 10 ** (-10 / 35) * last  # 10 dB of a wall
    assert radio.hears(walled - 1, 0.0, 1, 0.1)
    assert not radio.hears(walled + 1, 0.0, 1, 0.1)
