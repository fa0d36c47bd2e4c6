"""What the page shows of real robots is right: pictures, ages, scans, in Chromium."""

from __future__ import annotations

import colorsys
import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from console_browser import NO_GL
from console_rig import HUES, STALLS, WALL, Console, Tap, canvas, chromium, pair, real, shown, until
from lanes import slow_but
from numpy.typing import NDArray

from usarsim_server.testing import ServerProcess

pytest.importorskip("aiohttp")

SHARP = 2
"""Pixels of the screen for one of the page."""


VIEW = "-8,0,-6,1,0,0"
"""What the server's own camera sees, in its first tile: from where, to where, m, z down."""
BAD_LINK = """
[page.Ada]
delay_ms = 1000
jitter_ms = 20
loss_percent = 30
seed = 30
"""


class Rig:
    """Everything that runs, and an operator's page."""

    def __init__(
        self, server: ServerProcess, console: Console, tap: Tap, browser: Any, page: Any
    ) -> None:
        self.server, self.console, self.tap = server, console, tap
        self.browser, self.page = browser, page

    def choose(self, robot: str) -> None:
        self.page.click(f'[data-tile="{robot}"]')
        self.page.wait_for_selector(f'[data-tile="{robot}"][aria-pressed="true"]')

    def ask(self, *texts: dict[str, Any]) -> list[dict[str, Any]]:
        """What a page of its own is answered to texts, one after another."""
        token = self.console.urls["operator"].partition("#")[2]
        return self.page.evaluate(
            """([token, texts]) => new Promise((done) => {
                 const answers = [];
                 const socket = new WebSocket(`ws://${location.host}/socket`);
                 const beat = setInterval(() => {
                   if (socket.readyState === 1) socket.send('{"type":"ping","clock":0}');
                 }, 500);
                 socket.onclose = () => { clearInterval(beat); done(answers); };
                 const next = () => {
                   if (answers.length === texts.length) { socket.close(); return; }
                   const text = { ...texts[answers.length], id: answers.length + 1 };
                   socket.send(JSON.stringify(text));
                 };
                 socket.onopen = () =>
                   socket.send(JSON.stringify({ type: "hello", token, name: "test", clock: 0 }));
                 socket.onmessage = ({ data }) => {
                   const text = typeof data === "string" ? JSON.parse(data) : {};
                   if (text.type === "answer") answers.push(text);
                   if (text.type === "answer" || text.type === "welcome") next();
                 };
               })""",
            [token, list(texts)],
        )


@pytest.fixture(scope="module")
def rig(page_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """Four robots in four stalls."""
    with (
        real(tmp_path_factory.mktemp("rig"), 4, view=VIEW) as (server, console, tap),
        chromium(NO_GL) as browser,
        shown(browser, console.urls["operator"], device_scale_factor=SHARP) as page,
    ):
        until(lambda: page.locator("[data-camera=on]").count() == 4)
        yield Rig(server, console, tap, browser, page)


def hue(pixel: NDArray[np.float64]) -> str:
    """Which of the colours of the panels a pixel has."""
    degrees = {name: 360.0 * colorsys.rgb_to_hsv(*rgb)[0] for name, rgb in HUES.items()}
    here = 360.0 * colorsys.rgb_to_hsv(*(pixel[:3] / 255.0))[0]
    return min(degrees, key=lambda name: abs((here - degrees[name] + 180.0) % 360.0 - 180.0))


def panels(page: Any, robot: str) -> tuple[str, str]:
    """Colours left and right of the middle of a robot's picture, as the tile draws it."""
    seen = canvas(page, f'[data-tile="{robot}"] canvas')
    height, width = seen.shape[:2]
    left, right = (seen[height // 2, round(width * part)] for part in (0.42, 0.58))
    return hue(left), hue(right)


def test_each_of_four_pictures_is_of_the_right_robot(rig: Rig) -> None:
    """O-20: each robot looks at a wall of its own two colours; left is left."""
    for stall in range(4):
        until(lambda n=stall: panels(rig.page, f"R{n}") == pair(n))
    assert len({pair(stall) for stall in range(STALLS)}) == STALLS


def test_wall_stands_at_the_right_place_in_the_flat_plot(rig: Rig) -> None:
    """O-23: radius and bearing within 2 %, by the rings; beams without an echo are no hits."""
    rig.choose("R1")
    rig.page.click("[data-do=choose-flat]")
    panel = rig.page.locator("[data-panel=laser]")
    rig.page.wait_for_selector("[data-panel=laser][data-stale=false][data-scale]")
    scan = rig.page.evaluate(
        """() => { const { store } = usarsim; const s = store.slot(store.robot.index).scan;
                   return { fov: s.fov, most: s.maxRange, ranges: Array.from(s.ranges) }; }"""
    )
    seen = canvas(rig.page, "[data-panel=laser] canvas")
    scale = float(panel.get_attribute("data-scale")) * SHARP
    x0, y0 = (float(v) * SHARP for v in panel.get_attribute("data-origin").split())
    # The scale is that of the rings that a person reads.
    ring = seen[round(y0 - scale * 10.0) - 2 : round(y0 - scale * 10.0) + 3, round(x0) - 6, 3]
    assert ring.max() > 100.0
    # Hits are drawn in the colour of hits: opaque, unlike the swept floor.
    accent = np.array([int(v) for v in rig.page.evaluate(ACCENT)])
    hits = (np.abs(seen[..., :3] - accent).max(2) < 40) & (seen[..., 3] > 80)
    rows, columns = np.nonzero(hits)
    weight = seen[rows, columns, 3]
    wall = np.abs(columns - x0) < 0.85 * scale  # the panels of the robot's own stall
    ahead = float(np.average(rows[wall] + 0.5, weights=weight[wall]))
    assert (y0 - ahead) / scale == pytest.approx(WALL, rel=0.02)
    # Ends of the panels: 1 m to each side, at bearings of atan(1 / 2).
    near = (np.abs(columns - x0) < 1.6 * scale) & (np.abs(rows - ahead) < 3)
    for end in (columns[near].min(), columns[near].max() + 1):
        bearing = math.degrees(math.atan2(abs(end - x0) - 1.25 * SHARP, y0 - ahead))
        assert bearing == pytest.approx(math.degrees(math.atan2(1.0, WALL)), abs=1.0 + 0.02 * 27)
    # The gaps between stalls: at the greatest range, and no hit there.
    edge = [(row, column) for row, column in zip(rows, columns, strict=True)
            if math.hypot(row - y0, column - x0) > 0.99 * scale * scan["most"]]  # fmt: skip
    assert max(scan["ranges"]) >= scan["most"] * 0.999
    assert edge == []


ACCENT = """() => { const c = getComputedStyle(document.documentElement)
    .getPropertyValue("--accent").trim().slice(1);
  return [0, 2, 4].map((i) => parseInt(c.slice(i, i + 2), 16)); }"""


def test_classic_strips_are_taller_where_it_is_nearer(rig: Rig) -> None:
    """O-24: and left is left: the first stall has neighbours on its left only."""
    rig.choose("R0")
    rig.page.click("[data-do=choose-strips]")
    rig.page.wait_for_selector("[data-panel=laser][data-view=strips][data-stale=false]")
    ranges = np.array(rig.page.evaluate(
        "() => Array.from(usarsim.store.slot(usarsim.store.robot.index).scan.ranges)"
    ))  # fmt: skip
    seen = canvas(rig.page, "[data-panel=laser] canvas")
    wide = seen.shape[1] / len(ranges)
    middle = [round((beam + 0.5) * wide) for beam in range(len(ranges))]
    tall = np.array([np.count_nonzero(seen[:, column, 3] > 250) for column in middle])
    half = len(ranges) // 2
    hit = ranges < 19.9
    assert np.count_nonzero(tall[: half - 30]) > 10
    assert np.count_nonzero(tall[half + 30 : -2]) == 0
    assert (tall[hit & (np.arange(len(ranges)) != half)] > 0).all()
    assert (tall[~hit & (np.arange(len(ranges)) != half)] == 0).all()
    beams = [beam for beam in np.flatnonzero(hit) if beam != half]
    for one in beams:
        for other in beams:
            if ranges[one] < 0.9 * ranges[other]:
                # Far off the difference is less than a pixel.
                assert tall[one] > tall[other] or (tall[one] == tall[other] and ranges[one] > 5.0)


@pytest.mark.parametrize("what", slow_but("camera".__eq__, ["camera", "laser"]))
def test_each_stream_is_switched_by_itself(rig: Rig, what: str) -> None:
    """O-22: off ends it for that robot alone, on begins it again."""
    slot = {"camera": "picture", "laser": "scan"}[what]
    times = f"() => usarsim.store.robots.map((r) => usarsim.store.slot(r.index).{slot}?.time ?? 0)"
    states = f"() => usarsim.store.robots.map((r) => r.{what}.on)"
    for number in (1, 3):
        rig.choose(f"R{number}")
        rig.page.click(f"[data-do={what}]")
        until(lambda n=number: rig.page.evaluate(states) == [one != n for one in range(4)])
        if what == "camera":
            rig.page.wait_for_selector(f'[data-tile="R{number}"][data-camera="off"]')
        else:
            rig.page.wait_for_selector('[data-panel=laser][data-laser="off"]')

        def alone(n: int = number) -> bool:
            """Whether all others come for a second and this one does not; it may be under way."""
            before = rig.page.evaluate(times)
            until(lambda: all(
                rig.page.evaluate(times)[one] > before[one] + 1.0 for one in range(4) if one != n
            ))  # fmt: skip
            return bool(rig.page.evaluate(times)[n] == before[n])

        assert alone() or alone()
        before = rig.page.evaluate(times)
        rig.page.click(f"[data-do={what}]")
        until(lambda n=number, b=before: rig.page.evaluate(times)[n] > b[n] + 1.0)
        until(lambda: rig.page.evaluate(states) == [True] * 4)


def test_picture_of_a_camera_that_stops_is_stale(rig: Rig) -> None:
    """O-21: its age is shown; it is stale a second later while all else lives on."""
    fresh = "[data-tile][data-camera=on][data-stale=false]"
    until(lambda: rig.page.locator(fresh).count() == 4)
    assert re.fullmatch(r"\d\.\d s", rig.page.inner_text('[data-tile="R2"] [data-age]'))
    # What the next ping tells, once a second: how old each was when it was drawn.
    drawn = "() => [...usarsim.store.drawn.values()]"
    until(
        lambda: len(ages := rig.page.evaluate(drawn)) == 4 and all(0.0 <= one < 1.5 for one in ages)
    )
    rig.tap.hold(True)
    until(lambda: rig.page.locator(fresh).count() == 0)
    age = rig.page.evaluate(
        """() => { const { store } = usarsim; const r = store.robots[2];
                   return store.state.time - store.slot(r.index).picture.time; }"""
    )
    assert age > 0.6  # stale by age, not by mishap
    until(lambda: rig.page.get_attribute("[data-panel=laser]", "data-stale") == "false")
    until(lambda: rig.page.inner_text('[data-tile="R2"] .tile-note') == "frozen")
    rig.tap.hold(False)
    until(lambda: rig.page.locator(fresh).count() == 4)


@pytest.mark.slow
def test_delay_and_loss_of_a_bad_link_are_shown(rig: Rig, tmp_path: Path) -> None:
    """CON-31: measured at the page, within 10 % of what the console was told to make of it."""
    file = tmp_path / "bad.toml"
    file.write_text(BAD_LINK)
    told = (f"--impair={file}", f"--scene-port={rig.server.ports['scene']}",
            f"--image-port={rig.tap.port}")  # fmt: skip
    control = rig.server.ports["control"]

    def ada(page: Any) -> None:
        page.add_init_script("localStorage.setItem('usarsim-name', 'Ada')")

    with (
        Console(control, *told, folder=tmp_path) as console,
        shown(rig.browser, console.urls["instructor"], ada) as page,
    ):

        def right() -> bool:
            chip = "(({ title, innerText }) => [title, innerText])(document.querySelector('.link'))"
            title, text = page.evaluate(chip)
            delay, loss, frames = map(float, re.findall(r"[\d.]+", title))
            assert title == (
                f"delay {delay:.0f} ms each way (pings); "
                f"loss {loss:.1f} % of {frames:.0f} frames (last minute)"
            )
            assert re.fullmatch(r"link \d+ ms · \d+ % lost", text)
            assert abs(float(text.split()[4]) - loss) <= 0.6
            return delay == pytest.approx(1000.0, rel=0.1) and loss == pytest.approx(30.0, rel=0.1)

        until(lambda: page.evaluate("usarsim.store.losses.sent") > 300)
        until(right)


def test_without_webgl_the_server_shows_the_world(rig: Rig) -> None:
    """CON-24: at least two pictures of the spectator each simulated second, in the 3D tile."""
    with shown(rig.browser, rig.console.urls["instructor"]) as page:
        assert page.get_attribute("[data-panel=view3d]", "data-webgl") == "false"
        page.evaluate(
            """() => { window.came = []; usarsim.store.on("picture", (index) => {
                 if (index === 255) came.push(usarsim.store.slot(255).picture.time); }); }"""
        )
        until(lambda: page.evaluate("came.length > 2 && came.at(-1) - came[0] > 5"))
        came = page.evaluate("came")
        assert len(set(came)) - 1 >= 2.0 * (came[-1] - came[0])
        seen = canvas(page, "[data-spectator]")
        assert {hue(pixel) for pixel in seen[seen[..., :3].std(2) > 40]} >= {"red", "blue"}
    assert rig.page.evaluate("usarsim.store.slot(255).picture") is None


@pytest.mark.slow
def test_what_is_needed_now_and_then(rig: Rig) -> None:
    """Behind "More": robots that come and go, moves of a size (O-14), flippers, the camera; what
    moves a free robot takes it, and a camera has sliders only for what it can do."""
    page = rig.page
    row = "() => usarsim.store.robot"

    def sliders(what: str) -> dict[str, Any]:
        group = page.locator(f"[data-more] [aria-label={what}] label.slider")
        return {one.inner_text().split("\n")[0]: one.locator("input") for one in group.all()}

    page.click("[data-more] summary")
    for name, kind, stall in (("Ken", "Kenaf", 9), ("Pan", "P2AT", 12)):
        for label, text in (("class", kind), ("name", name), ("start", f"Stall{stall}")):
            page.fill(f"[data-more] [aria-label={label}]", text)
        page.click("[data-more] [data-do=spawn]")
        page.wait_for_selector(f'[data-tile="{name}"][data-camera=on]')
    rig.choose("R1")
    until(lambda: list(sliders("Camera")) == ["field of view"])
    assert page.locator("[data-more] [aria-label=Flippers]").is_hidden()

    rig.choose("Ken")
    page.fill("[data-more] [aria-label='angle, degrees']", "30")
    page.click("[data-do=rotate-right]")
    page.wait_for_selector("[data-notices] p:has-text('Ken: move done')")
    page.wait_for_selector("[data-field=holder]:text-is('you drive')")
    until(lambda: abs(math.degrees(page.evaluate(row)["pose"][5]) - 30.0) < 1.0)
    for place, one in enumerate(sliders("Flippers").values()):
        one.fill(str(10 + 10 * place))
    told = {"FRFlipper": 10.0, "FLFlipper": 20.0, "RRFlipper": 30.0, "RLFlipper": 40.0}
    until(lambda: {name: round(math.degrees(angle)) for name, angle
                   in page.evaluate(row)["joints"].items()} == told)  # fmt: skip
    page.click("[data-do=light]")
    until(lambda: page.evaluate(row)["light"])

    rig.choose("Pan")
    until(lambda: list(sliders("Camera")) == ["pan", "tilt", "field of view"])
    yaw = page.evaluate(row)["camera"]["yaw"]
    for label, degrees in (("pan", 20), ("tilt", -10), ("field of view", 40)):
        sliders("Camera")[label].fill(str(degrees))
    until(lambda: page.evaluate(row)["camera"]["yaw"] == pytest.approx(yaw + 0.349, abs=0.02))
    until(lambda: page.evaluate(row)["camera"]["turned"]["tilt"] == pytest.approx(-0.175, abs=0.02))
    fov = math.radians(40.0)
    until(lambda: page.evaluate(row)["camera"]["fov"] == pytest.approx(fov, abs=1e-3))

    remove = page.locator("[data-do=remove]")
    rig.choose("Ken")
    assert remove.evaluate("(one) => { one.click(); return one.textContent; }") == "Remove Ken?"
    rig.choose("Pan")  # the question is about Ken
    for name in ("Pan", "Ken"):
        rig.choose(name)
        assert remove.evaluate("(one) => one.textContent") == "Remove this one"
        twice = "(one) => { one.click(); const said = one.textContent; one.click(); return said; }"
        assert remove.evaluate(twice) == f"Remove {name}?"
        page.wait_for_selector(f'[data-tile="{name}"]', state="detached")
    page.click("[data-more] summary")


@pytest.mark.slow
def test_each_of_sixteen_pictures_is_of_the_right_robot(rig: Rig) -> None:
    """O-20: twelve robots more, by a page's wish."""
    more = [{"type": "spawn", "class": "P3AT", "name": f"R{n}", "start": f"Stall{n}"}
            for n in range(4, STALLS)]  # fmt: skip
    assert all(answer["ok"] for answer in rig.ask(*more)), json.dumps(more)
    until(lambda: rig.page.locator("[data-tile][data-camera=on]").count() == STALLS)
    for stall in range(STALLS):
        until(lambda n=stall: panels(rig.page, f"R{n}") == pair(n))
