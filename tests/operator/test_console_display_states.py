"""What the page shows of states that are hard to bring about: told by a fake gateway."""

from __future__ import annotations

import colorsys
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from lanes import slow_but

pytest.importorskip("aiohttp")

from console_browser import NO_GL
from console_rig import Played, canvas, chromium, escaped_twice, shown, until
from console_rig import pixels as screen

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("page_folder")]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Without WebGL: what is tried here needs none."""
    with chromium(NO_GL) as running:
        yield running


@pytest.fixture
def played() -> Iterator[Played]:
    """Four robots."""
    one = Played(4)
    with one:
        yield one


STALE = """() => Object.fromEntries(
  ["header", "[data-tile]", "[data-robot]", "[data-panel=laser]", "[data-panel=map]",
   "[data-panel=card]", "[data-panel=view3d]", "[data-sensor]"].map((what) => [
     what, [...document.querySelectorAll(what)].map((one) => one.dataset.stale ?? "absent")]))"""


def test_frozen_input_is_stale_everywhere(browser: Any, played: Played) -> None:
    """CON-19: within 1.2 s of the page's clock, every tile, map, laser and status."""
    with shown(browser, played.url("instructor"), before=lambda page: page.clock.install()) as page:
        until(lambda: all(set(all_) == {"false"} for all_ in page.evaluate(STALE).values()))
        # Far ahead: the page may be busy for long between telling its time and standing still.
        page.clock.pause_at(page.evaluate("Date.now() / 1000 + 600"))

        def heard() -> bool:
            page.clock.run_for(20)
            return all(set(all_) == {"false"} for all_ in page.evaluate(STALE).values())

        until(heard)
        # The page's clock stands: what comes by now, all of it anew, is of no age when all ends.
        since = page.evaluate("usarsim.store.state.time")
        until(lambda: page.evaluate("usarsim.store.state.time") > since + 1.0)
        played.gateway.frozen = True
        # The last text has arrived, and with it all that was sent before.
        until(lambda: page.evaluate("usarsim.store.state.time") == played.gateway.last_time)
        page.clock.run_for(300)
        fresh = page.evaluate(STALE)
        assert all(set(all_) == {"false"} for all_ in fresh.values()), fresh
        page.clock.run_for(900)
        stale = page.evaluate(STALE)
        assert all(set(all_) == {"true"} for all_ in stale.values()), str(stale)
        assert page.inner_text(".link") == "no data"
        assert page.inner_text('[data-tile="R1"] .tile-note') == "frozen"
        played.gateway.frozen = False
        page.clock.resume()
        until(lambda: set(page.evaluate(STALE)["[data-tile]"]) == {"false"})


def test_ages_that_the_gateway_tells_count(browser: Any, played: Played) -> None:
    """CON-19: a server that hangs stops the simulated time, yet nothing keeps its live look."""
    plain = played.gateway.robot

    def hung(i: int) -> dict[str, Any]:
        row = plain(i)
        old = {"age": 1.4}
        return {
            **row,
            "pose_age": 1.4,
            "link": {**row["link"], **old},
            "sensors": [{**one, **old} for one in row["sensors"]],
            "camera": {**row["camera"], **old},
            "laser": {**row["laser"], **old},
        }

    with shown(browser, played.url("operator")) as page:
        until(lambda: set(page.evaluate(STALE)["[data-tile]"]) == {"false"})
        played.gateway.robot = hung
        until(
            lambda: all(
                set(all_) == {"true"}
                for what, all_ in page.evaluate(STALE).items()
                if what != "header"
            )
        )
        # A world that was halted on purpose is old nowhere.
        played.gateway.paused = True
        until(lambda: set(page.evaluate(STALE)["[data-tile]"]) == {"false"})


def test_no_age_is_negative(browser: Any, played: Played) -> None:
    """CON-19: a clock that is behind is told as 0.0 s in every panel, what never came as never."""
    plain = played.gateway.robot

    def early(i: int) -> dict[str, Any]:
        row, age = plain(i), {"age": -15.7 if i == 0 else 1e6}
        sensors = [{**one, **age} for one in row["sensors"]]
        link = {**row["link"], **age, "signal_dbm": None}
        more = {"pose_age": age["age"], "link": link, "sensors": sensors}
        return {**row, **more, **{key: {**row[key], **age} for key in ("camera", "laser")}}

    played.gateway.robot = early
    with shown(browser, played.url("operator"), viewport={"width": 1366, "height": 900}) as page:
        heard = "[data-chart='last heard'] output"
        until(lambda: page.locator(heard).count() and "ago" in page.inner_text(heard))
        assert page.inner_text(heard) == "0.0 s ago"
        seen = page.inner_text("body")
        assert re.search(r"[-−]\d+(\.\d+)? (s|min)\b", seen) is None
        page.click("[data-robot=R2]")
        until(lambda: page.inner_text(heard) == "unknown")
        assert "Hz · –" in page.inner_text("[data-sensors]")
        assert "1000000" not in page.inner_text("body")


def test_clock_in_lockstep(browser: Any, played: Played) -> None:
    """CON-20: a world without a pace of its own: the clock is what was told last, and waits."""
    played.gateway.paused = True
    plain = played.gateway.state
    played.gateway.state = lambda: {**plain(), "paused": False, "speed": None}
    with shown(browser, played.url("instructor")) as page:
        for time, text in ((100.7, "01:40"), (161.2, "02:41"), (3599.99, "59:59")):
            played.gateway.time = time
            until(lambda t=text: page.inner_text("[data-clock]") == t)
            page.wait_for_timeout(700)
            assert page.inner_text("[data-clock]") == text


def test_a_flood_of_alarms_is_five_lines(browser: Any, played: Played) -> None:
    """CON-18: the gravest of a hundred first, the rest counted, and none lost."""
    flood = [
        {"id": n, "robot": f"R{n % 4 + 1}", "kind": "collision", "severity": 1 + n * 7 % 3,
         "text": f"cause {n}", "since": 40.0 + n / 10, "acknowledged": False, "count": 1}
        for n in range(100)
    ]  # fmt: skip
    with shown(browser, played.url("operator")) as page:
        for told in (10, 50, 100):
            played.gateway.alarms = lambda n=told: flood[:n]
            until(lambda n=told: page.inner_text("[data-alarms-hidden]") == f"and {n - 5} more")
            rows = page.locator("[data-alarm]")
            severities = (
                "[...document.querySelectorAll('[data-alarm]')].map((one) => +one.dataset.severity)"
            )
            expected = sorted((one["severity"] for one in flood[:told]), reverse=True)[:5]
            until(lambda e=expected, s=severities: page.evaluate(s) == e)
        box = page.locator("[data-panel=alarms]").bounding_box()
        last = rows.last.bounding_box()
        assert last["y"] + last["height"] <= box["y"] + box["height"]
        page.keyboard.press("k")
        until(lambda: any(text["type"] == "acknowledge" for _, text in played.gateway.texts))


@pytest.mark.parametrize("robots", slow_but((4).__eq__, [4, 16]))
def test_tiles_choice_and_stop(browser: Any, robots: int) -> None:
    """O-20, O-25, CON-15: n tiles; digits choose; Escape twice stops all."""
    played = Played(robots)
    with played, shown(browser, played.url("instructor")) as page:
        until(lambda: page.locator("[data-tile]").count() == robots)
        page.keyboard.press("3")
        page.wait_for_selector('[data-tile="R3"][aria-pressed="true"]')
        until(lambda: escaped_twice(page, lambda: played.gateway.stopped))


HUES = {"yellow": 56.0, "orange": 41.0, "red": 2.0, "blue": 208.0}


@pytest.mark.parametrize("theme", slow_but("dark".__eq__, ["dark", "light"]))
def test_map_shows_zones_robots_paths_and_marks(browser: Any, played: Played, theme: str) -> None:
    """CON-10: each zone's centre has its hue within 10 degrees; a letter tells it, too."""
    played.gateway.marks.append(
        {"id": 1, "robot": "R1", "place": [4.5, 3.0, 0.0], "status": "alive", "note": "",
         "by": "Ada", "time": 41.0}
    )  # fmt: skip
    with shown(browser, played.url("instructor"), color_scheme=theme) as page:
        view = page.locator("[data-panel=map]")

        def layers(*shown: str) -> None:
            """Show these layers only."""
            for one in ("map", "zones", "paths", "robots", "marks"):
                button = view.locator(f"[data-do=layer-{one}]")
                if (button.get_attribute("aria-pressed") == "true") != (one in shown):
                    button.click()
            before = page.evaluate("usarsim.map.drawn")
            until(lambda: page.evaluate("usarsim.map.drawn") > before + 1)

        def pixels(*shown: str) -> Any:
            """The canvas of the map with these layers only."""
            layers(*shown)
            return canvas(page, "[data-panel=map] canvas")

        until(lambda: view.get_attribute("data-stale") == "false")
        zones = pixels("zones")
        bare = pixels()
        place = {what: page.evaluate(f"usarsim.map.at({x}, {y})") for what, x, y in (
            ("yellow", 3.15, 3.15), ("orange", -3.15, 3.15), ("red", -3.15, -3.15),
            ("blue", 3.15, -3.15))}  # fmt: skip
        ground = page.evaluate("getComputedStyle(document.querySelector('.stage')).backgroundColor")
        for colour, (x, y) in place.items():
            x, y = round(x), round(y)
            rgb, part = zones[y, x, :3] / 255.0, zones[y, x, 3] / 255.0
            assert 0.2 < part < 0.6, ground  # what lies below is still seen
            here = 360.0 * colorsys.rgb_to_hsv(*rgb)[0]
            assert abs((here - HUES[colour] + 180.0) % 360.0 - 180.0) < 10.0
            # The letter: opaque pixels below the centre, other ones for each zone.
            letter = zones[y + 8 : y + 26, x - 8 : x + 9, 3] > 200
            assert np.count_nonzero(letter) > 20
            assert np.count_nonzero(bare[y + 8 : y + 26, x - 8 : x + 9, 3]) == 0
        # On the screen, above the map that robots made.
        layers("map", "zones")
        seen = screen(page, "[data-panel=map] canvas")
        for colour, (x, y) in place.items():
            rgb = seen[round(y), round(x)] / 255.0
            here = 360.0 * colorsys.rgb_to_hsv(*rgb)[0]
            assert abs((here - HUES[colour] + 180.0) % 360.0 - 180.0) < 10.0, (colour, rgb)
        for layer, (px, py) in (("marks", (4.5, 3.0)), ("map", (5.9, 0.0))):
            x, y = (round(v) for v in page.evaluate(f"usarsim.map.at({px}, {py})"))
            shown_ = pixels(layer)[y - 2 : y + 3, x - 2 : x + 3, 3]
            assert shown_.max() > 200, layer
            assert bare[y - 2 : y + 3, x - 2 : x + 3, 3].max() < 200, layer
        # Paths are circles through where robots are, each in the colour of its robot.
        none = np.count_nonzero(bare[..., 3])
        until(lambda: np.count_nonzero(pixels("paths")[..., 3]) > none + 60)
        played.gateway.paused = True  # they stand still where they are looked for
        until(lambda: page.evaluate("usarsim.store.state.time") == played.gateway.time)
        robots = pixels("robots")
        spots = page.evaluate(
            "usarsim.store.robots.map((r) => usarsim.map.at(r.pose[0], r.pose[1]))"
        )
        for x, y in spots:
            near = robots[round(y) - 14 : round(y) + 15, round(x) - 14 : round(x) + 15, 3]
            assert np.count_nonzero(near > 200) > 40


def test_a_letter_tells_a_zone_that_is_too_small_for_it(browser: Any, played: Played) -> None:
    """CON-10: it stands beside the zone, whose centre keeps its hue."""
    small = [{"colour": colour, "corners": [[x, -2.0], [x + 0.6, -2.0], [x + 0.6, -1.4], [x, -1.4]]}
             for colour, x in zip(HUES, (-3.0, -1.0, 1.0, 3.0), strict=True)]  # fmt: skip
    plain = played.gateway.state
    played.gateway.state = lambda: {**plain(), "zones": small}
    with shown(browser, played.url("instructor")) as page:
        for one in ("map", "paths", "robots", "marks"):
            page.click(f"[data-do=layer-{one}]")
        until(lambda: page.evaluate("usarsim.store.state.zones[0].corners[0][0] === -3"))
        before = page.evaluate("usarsim.map.drawn")
        until(lambda: page.evaluate("usarsim.map.drawn") > before + 1)
        seen = canvas(page, "[data-panel=map] canvas")
        letters = []
        for (colour, hue), zone in zip(HUES.items(), small, strict=True):
            x, y = zone["corners"][0][0] + 0.3, zone["corners"][0][1] + 0.3
            column, row = map(round, page.evaluate(f"usarsim.map.at({x}, {y})"))
            here = 360.0 * colorsys.rgb_to_hsv(*(seen[row, column, :3] / 255.0))[0]
            assert abs((here - hue + 180.0) % 360.0 - 180.0) < 10.0, colour
            right = round(page.evaluate(f"usarsim.map.at({x}, {y + 0.3})")[0])
            letters.append(seen[row - 7 : row + 8, right + 3 : right + 16, 3] > 200)
        assert all(np.count_nonzero(one) > 15 for one in letters)
        assert len({one.tobytes() for one in letters}) == len(letters)


def test_without_webgl(browser: Any, played: Played) -> None:
    """CON-24: the 3D tile shows the server's pictures, one hint, nothing in the browser's log."""
    with shown(browser, played.url("instructor")) as page:
        page.wait_for_selector("[data-panel=view3d][data-webgl=false]")
        until(lambda: page.evaluate("document.querySelector('[data-spectator]').width") == 320)
        assert page.locator("[data-panel=view3d] .empty:not(:empty)").count() <= 1
        assert "WebGL" not in page.inner_text("[data-notices]")
        frames = "() => usarsim.store.slot(255).picture?.time ?? 0"
        first = page.evaluate(frames)
        until(lambda: page.evaluate(frames) > first)
        until(lambda: page.locator("[data-tile][data-stale=false]").count() == 4)
        laser = "[data-panel=laser] canvas"
        until(lambda: np.count_nonzero(canvas(page, laser)[..., 3]) > 1000)
        page.keyboard.press("2")
        page.wait_for_selector('[data-tile="R2"][aria-pressed="true"]')
