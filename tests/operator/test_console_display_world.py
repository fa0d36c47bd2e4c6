"""The true world in the page's 3D view, and its clock, in Chromium at a real server."""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from console_browser import FLAGS
from console_rig import (
    PANEL_TOP,
    SCANNER,
    WALL,
    ZONES,
    Console,
    Played,
    chromium,
    place,
    real,
    shown,
    until,
)
from lanes import slow_but
from numpy.typing import NDArray

from usarsim_client.decoder import decode
from usarsim_client.frames import flip, quaternion
from usarsim_client.readings import GroundTruth, Pose
from usarsim_server.testing import ScriptedClient, ServerProcess

pytest.importorskip("aiohttp")
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("page_folder")]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """With WebGL."""
    with chromium(FLAGS) as running:
        yield running


class Rig:
    """Everything that runs, and an instructor's page."""

    def __init__(self, server: ServerProcess, console: Console, page: Any) -> None:
        self.server, self.console, self.page = server, console, page


@pytest.fixture(scope="module")
def rig(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """Two robots with a scanner of rows; what is drawn of them nobody looks at, so it is small."""
    small = {"width": 480, "height": 320}
    with (
        real(tmp_path_factory.mktemp("rig"), 2, kind="Looker") as (server, console, _),
        shown(browser, console.urls["instructor"], viewport=small) as page,
    ):
        until(lambda: page.get_attribute("[data-panel=view3d]", "data-scene"))
        yield Rig(server, console, page)


def test_points_lie_on_the_box_that_is_there(rig: Rig) -> None:
    """CON-09: rows of a 3D scanner within 3 cm of the panels; the flat scan at its true height."""
    page = rig.page
    until(lambda: page.evaluate("usarsim.store.slot(0).points !== undefined"))
    face, flat = SCANNER[0] + WALL, 0.145 + SCANNER[2]

    def look() -> NDArray[np.float64]:
        return np.array(page.evaluate("usarsim.cloud()")).reshape(-1, 3)

    until(lambda: look()[:, 2].max(initial=0.0) > flat + 0.3)  # all rows have come
    x, y, z = look().T
    own = np.abs(y - place(0)) < 0.98
    ahead = own & (np.abs(x - face) < 0.3)
    assert np.abs(x[ahead] - face).max() < 0.03
    assert (z[ahead] < PANEL_TOP + 0.03).all()
    # What the scanner of rows sees besides is the floor.
    rest = own & ~ahead & (x > 0.3)
    assert np.abs(z[rest]).max(initial=0.0) < 0.03
    # Its rows: some well above, some well below the flat scan, which is at 0.345 m.
    heights = z[ahead]
    assert heights.max() > flat + 0.3
    # The flat scan sees the panel by 53 beams, all at one height.
    assert np.count_nonzero(np.abs(heights - flat) < 0.01) >= 45


def drive(client: ScriptedClient, rows: list[Pose], stop: threading.Event) -> None:
    """Drive by turns until told to stop; notes where the robot truly was, and when."""
    turns = itertools.cycle(((6.0, 4.5), (-4.0, -6.0), (5.0, 5.5), (-6.0, -4.0)))
    due = -math.inf
    while not stop.is_set():
        try:
            line = client.read_line()
        except OSError:  # it was told to leave
            return
        for value in decode(line.encode("latin-1")):
            if isinstance(value, GroundTruth):
                rows.append(value)
                if value.time > due:
                    due = value.time + 2.0
                    left, right = next(turns)
                    client.send(f"DRIVE {{Left {left}}} {{Right {right}}}")


RECORD = """() => { const seen = (window.seen = []); const last = {};
  setInterval(() => { for (const name of ["A", "B", "C"]) {
    const now = usarsim.poseOf(name);
    if (now && now.time !== last[name]) { last[name] = now.time; seen.push([name, now]); } }
  }, 15); }"""


@pytest.mark.slow
def test_meshes_are_where_robots_are(rig: Rig) -> None:
    """CON-06: 60 s of driving over a hill, robots joined and left: below 5 mm and half a degree.

    No robot of that class is there before, and none to spare when the next one joins: the model is
    compiled anew each time.
    """
    page, stop = rig.page, threading.Event()
    truth: dict[str, list[Pose]] = {name: [] for name in "ABC"}
    clients: dict[str, ScriptedClient] = {}
    threads: dict[str, threading.Thread] = {}

    def join(name: str, spot: int) -> None:
        client = clients[name] = rig.server.client()
        client.wait_for("NFO")
        client.send(f"INIT {{ClassName USARBot.Roamer}} {{Name {name}}} {{Start Hill{spot}}}")
        task = threading.Thread(target=drive, args=(client, truth[name], stop), daemon=True)
        threads[name] = task
        task.start()

    page.select_option("[data-do=speed]", "4")
    page.evaluate(RECORD)
    join("A", 0)
    until(lambda: truth["A"])
    began = truth["A"][0].time
    for name, spot, after in (("B", 1, 10.0), ("C", 2, 25.0)):
        until(lambda t=began + after: truth["A"][-1].time > t)
        join(name, spot)
    until(lambda: truth["C"] and truth["A"][-1].time > began + 40.0)
    clients["B"].socket.shutdown(2)
    until(lambda: page.evaluate("usarsim.poseOf('B') === null"))
    until(lambda: truth["A"][-1].time > began + 62.0)
    stop.set()
    page.select_option("[data-do=speed]", "1")
    seen = page.evaluate("window.seen")
    for name, rows in truth.items():
        error = errors([one for who, one in seen if who == name], rows)
        assert len(error) > 0, name
        assert error[:, 0].max() < 0.005, name
        assert error[:, 1].max() < math.radians(0.5), name
        if name == "A":  # the others are there for a part of the time
            height, roll, pitch = np.ptp(error[:, 2:], axis=0)
            assert height > 0.03
            assert min(roll, pitch) > math.radians(1.5)
    for client in clients.values():
        client.close()


def test_zones_are_where_the_world_has_them(rig: Rig) -> None:
    """CON-10: told to the instructor with what robots stand in; an operator knows nothing of it."""
    page = rig.page
    until(lambda: len(page.evaluate("usarsim.store.state.zones ?? []")) == 4)
    for stall, zone in enumerate(page.evaluate("usarsim.store.state.zones")):
        assert zone["colour"] == ZONES[stall]
        # y of the wire is to the right.
        assert np.mean(zone["corners"], axis=0) == pytest.approx([1.0, -place(stall)])
    stand = "usarsim.store.robots.map((r) => r.zone)"
    until(lambda: page.evaluate(stand) == ["yellow", "orange"])  # others of earlier tests leave
    with shown(page.context.browser, rig.console.urls["operator"]) as other:
        until(lambda: other.evaluate("usarsim.store.robots.length") == 2)
        assert other.evaluate("usarsim.store.state.zones === undefined")
        assert other.evaluate(stand) == [None, None]


CLOCK = """() => { const text = document.querySelector("[data-clock]").textContent;
  const clock = text.split(":").reduce((sum, part) => 60 * sum + Number(part), 0);
  return [clock, usarsim.poseOf("R0").time, usarsim.store.state.time]; }"""


@pytest.mark.parametrize("factor", slow_but({4}.__contains__, [0.5, 1, 4]))
def test_clock_is_the_simulated_time(rig: Rig, factor: float) -> None:
    """CON-20: within a report of the world's own time, in whole seconds."""
    page = rig.page
    page.select_option("[data-do=speed]", str(factor))
    until(lambda: page.evaluate("usarsim.store.state.speed") == factor)
    slack = 0.2 + 0.5 * factor  # a report, and what passes until the text is changed
    seen: list[list[float]] = []
    while len({clock for clock, _, _ in seen}) < 4:
        seen.append(page.evaluate(CLOCK))
        page.wait_for_timeout(100)
    # Most of the time: what is on its way to a page that is kept waiting is later.
    clock, true, told = np.array(seen).T
    assert -1.0 - slack < np.median(clock - true) < slack
    assert np.median(np.abs(told - true)) < slack
    page.select_option("[data-do=speed]", "1")


def test_clock_stands_with_the_world(rig: Rig) -> None:
    """CON-20: paused, it shows the second at which the world was halted, for as long as it is."""
    page = rig.page
    page.click("[data-do=pause]")
    until(lambda: page.evaluate("usarsim.store.state.paused"))

    def stands() -> list[float] | None:
        first: list[float] = page.evaluate(CLOCK)
        page.wait_for_timeout(1500)
        return first if page.evaluate(CLOCK) == first else None

    first = stands() or stands()  # what was said before may be on its way to the first one
    assert first is not None
    assert first[0] == math.floor(first[2])
    assert abs(first[2] - first[1]) < 0.3
    page.click("[data-do=pause]")
    until(lambda: page.evaluate(CLOCK)[0] > first[0] + 1)


def errors(seen: list[dict[str, Any]], rows: list[Pose]) -> NDArray[np.float64]:
    """(n, 5): m and rad between the page's mesh and the truth at the same simulated time, and z
    (m), roll and pitch (rad) of the truth."""
    times = np.array([row.time for row in rows])
    found = []
    for one in seen:
        after = int(np.searchsorted(times, one["time"]))
        if not 0 < after < len(rows) or one["time"] < times[0] + 1.0:  # it falls to the ground
            continue
        here, there = rows[after - 1], rows[after]
        if there.time - here.time > 0.06:  # between two reports it need not have moved evenly
            continue
        part = (one["time"] - here.time) / (there.time - here.time)
        at = np.array(here.location) * (1.0 - part) + np.array(there.location) * part
        # About the first one, as angles jump.
        turned = np.remainder(np.subtract(there.orientation, here.orientation) + math.pi, math.tau)
        facing = np.array(here.orientation) + part * (turned - math.pi)
        x, y, z, *turn = one["pose"]  # of MuJoCo's frame
        true = quaternion(flip((facing[0], facing[1], facing[2])))
        off = 2.0 * math.acos(min(1.0, abs(float(np.dot(turn, true)))))
        found.append((math.dist((x, y, z), flip((at[0], at[1], at[2]))), off, at[2], *facing[:2]))
    return np.array(found)


@pytest.mark.slow
def test_view_that_takes_too_long_draws_less(browser: Any) -> None:
    """CON-08: frames of more than 100 ms make the view smaller, then rare; input goes on."""
    slow = """() => { const g = WebGL2RenderingContext.prototype; const plain = g.flush;
      g.flush = function () { const end = performance.now() + 130;
        while (performance.now() < end); plain.call(this); }; }"""
    played = Played(4)
    with played, shown(browser, played.url("instructor")) as page:
        view = page.locator("[data-panel=view3d]")
        until(lambda: view.get_attribute("data-scene") == "1")
        full = page.evaluate("document.querySelector('[data-panel=view3d] canvas').width")
        page.evaluate(slow)
        until(lambda: view.get_attribute("data-quality") == "demand")
        # A picture in which nothing has moved for a while is sharp, whatever the quality.
        width = "document.querySelector('[data-panel=view3d] canvas').width"
        until(lambda: page.evaluate(width) < full)
        count = """() => [performance.now() / 1000,
          Number(document.querySelector("[data-panel=view3d]").dataset.frames)]"""
        start, before = page.evaluate(count)
        page.keyboard.down("w")
        drives = played.gateway.texts
        until(lambda: sum(text["type"] == "drive" for _, text in drives) > 30)
        page.keyboard.up("w")
        until(lambda: [t for _, t in drives if t["type"] == "drive"][-1]["left"] == 0)
        end, after = page.evaluate(count)
        # Two a second; the first comes at once, two more as the size changes there and back.
        assert after - before <= 2.0 * (end - start) + 3.0


SPY = """
window.marks = {};
const plain = Path2D;
window.Path2D = class extends plain { constructor(d) { super(d); this.d = d; } };
const fill = CanvasRenderingContext2D.prototype.fill;
CanvasRenderingContext2D.prototype.fill = function (path, ...more) {
  if (path?.d) {
    const where = (window.marks[this.canvas.getAttribute("aria-label") ?? "label"] ??= new Set());
    where.add(`${path.d} ${this.fillStyle}`);
  }
  if (path) fill.call(this, path, ...more);
  else fill.call(this);
};
"""
LOOKS = """(where) => [...document.querySelectorAll(where)].map((one) => {
  const path = one.querySelector(".robot-mark path");
  return `${path.getAttribute("d")} ${path.getAttribute("fill")}`; })"""


@pytest.mark.slow
def test_sixteen_robots_have_sixteen_looks(browser: Any) -> None:
    """O-27: a mark and a colour for each, the same in list, tiles, map, 3D view and card."""
    played = Played(16)

    def spied(page: Any) -> None:
        page.add_init_script(SPY)

    with played, shown(browser, played.url("instructor"), spied) as page:
        until(lambda: page.locator("[data-robot] .robot-mark[data-look]").count() == 16)
        listed = page.evaluate(LOOKS, "[data-robot]")
        assert len(set(listed)) == 16
        assert page.evaluate(LOOKS, "[data-tile]") == listed
        for where in ("map", "label"):
            until(lambda w=where: page.evaluate(f"window.marks['{w}']?.size >= 16"))
            assert set(page.evaluate(f"[...window.marks['{where}']]")) == set(listed)
        page.keyboard.press("7")
        until(lambda: page.evaluate(LOOKS, "[data-panel=card]") == [listed[6]])


@pytest.mark.parametrize("role", slow_but("operator".__eq__, ["instructor", "operator"]))
def test_orbit_turns_around_the_chosen_robot(browser: Any, role: str) -> None:
    """Chosen robots are its centre; it leaves first person, and Home comes back from anywhere."""
    played = Played(4)
    played.gateway.paused = True

    def eye() -> tuple[NDArray[np.float64], NDArray[np.float64], str]:
        found = page.evaluate("usarsim.eye()")
        return np.array(found["at"]), np.array(found["target"]), found["mode"]

    def centred(robot: int, within: float = 0.01) -> bool:
        x, y, _ = played.gateway.places[robot]
        at, target, mode = eye()
        near = math.hypot(target[0] - x, target[1] + y) < within
        return mode == "orbit" and near and bool(np.linalg.norm(at - target) > 1.0)

    with played, shown(browser, played.url(role)) as page:
        frames = "document.querySelector('[data-panel=view3d]').dataset.frames > 1"
        until(lambda: page.evaluate(frames))
        until(lambda: page.evaluate("usarsim.store.robot?.name === 'R1'"))
        page.click("[data-robot=R3]")
        until(lambda: centred(2))
        before = np.subtract(*eye()[:2])
        page.keyboard.press("2")
        until(lambda: centred(1))
        assert np.subtract(*eye()[:2]) == pytest.approx(before, abs=1e-3)

        page.click("[data-do=choose-first]")
        x, y, _ = played.gateway.places[1]
        until(lambda: math.hypot(eye()[0][0] - x, eye()[0][1] + y) < 0.4)
        page.click("[data-do=choose-orbit]")
        until(lambda: centred(1, 1.7))  # ahead of it
        assert eye()[0][2] > 2.0

        home = eye()
        view = page.locator("[data-panel=view3d] canvas")
        view.drag_to(view, source_position={"x": 60, "y": 60}, target_position={"x": 160, "y": 90})
        until(lambda: np.linalg.norm(eye()[0] - home[0]) > 0.5)
        page.click("[data-do=choose-first]")
        page.click("[data-do=view-home]")
        until(lambda: np.linalg.norm(eye()[0] - home[0]) < 0.05)
        assert page.get_attribute("[data-do=choose-orbit]", "aria-pressed") == "true"
