"""Where things are on the page at every size: Stop is seen, and no control lies on another."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from lanes import slow_but

pytest.importorskip("aiohttp")

from console_browser import NO_GL
from console_rig import Played, chromium, shown, until

pytestmark = pytest.mark.usefixtures("page_folder")

ROLES = ("operator", "instructor", "viewer")
WIDTHS = (320, 390, 600, 768, 820, 900, 1024, 1280, 1366, 1920, 3840)
HEIGHTS = (320, 480, 768, 1180)
ZOOMED = ((1120, 640), (1093, 614), (1024, 640), (960, 540), (853, 533))
"""Windows of laptops whose pages are shown at 125 to 200 %."""
SIZES = [(width, height) for width in WIDTHS for height in HEIGHTS] + [*ZOOMED, (3840, 2160)]
FEW = [(320, 480), (853, 533), (1024, 768), (1920, 1180)]
"""A phone, a laptop's window that is zoomed, a tablet, a large screen: the other sizes are slow."""
DEVICES: dict[str, dict[str, Any]] = {
    "mouse": {},
    "touch": {"has_touch": True, "is_mobile": True},
}

LOOK = """() => {
  const wrong = [];
  const name = (one) => one.dataset.do ?? one.dataset.tile ?? one.dataset.stick
    ?? one.dataset.robot ?? one.getAttribute("aria-label") ?? one.tagName;
  // What is seen of an element: the rest is cut off by what it stands in, or by the window.
  const seen = (one) => {
    const box = one.getBoundingClientRect();
    const found = { left: box.left, top: box.top, right: box.right, bottom: box.bottom };
    const cut = (left, top, right, bottom) => {
      found.left = Math.max(found.left, left);
      found.top = Math.max(found.top, top);
      found.right = Math.min(found.right, right);
      found.bottom = Math.min(found.bottom, bottom);
    };
    cut(0, 0, innerWidth, innerHeight);
    for (let up = one.parentElement; up; up = up.parentElement) {
      if (getComputedStyle(up).overflow === "visible") continue;
      const { left, top } = up.getBoundingClientRect();
      cut(left, top, left + up.clientLeft + up.clientWidth, top + up.clientTop + up.clientHeight);
    }
    found.wide = found.right - found.left;
    found.high = found.bottom - found.top;
    return found;
  };
  const stop = document.querySelector("[data-do=estop]");
  const dialog = document.querySelector("dialog[open]");
  if (document.documentElement.scrollWidth > innerWidth)
    wrong.push("the page is wider than the window");
  if (!stop.hidden) {
    const box = stop.getBoundingClientRect();
    const { wide, high } = seen(stop);
    if (wide < box.width - 1 || high < box.height - 1 || box.width < 60 || box.height < 30)
      wrong.push(`Stop is ${wide} x ${high} of ${box.width} x ${box.height}`);
    const top = document.elementFromPoint(box.left + box.width / 2, box.top + box.height / 2);
    if (top !== stop) wrong.push("something lies on Stop");
  }
  const kinds = "button, select, input, summary, .robot-row, .stick, .stage canvas";
  const all = [...(dialog ?? document).querySelectorAll(kinds)]
    .filter((one) => one.checkVisibility({ visibilityProperty: true }) && !one.closest("datalist"))
    .filter((one) => one.getClientRects().length > 0);
  if (dialog && !stop.hidden) all.push(stop);
  const boxes = all.map((one) => [one, seen(one)]);
  boxes.forEach(([one, a], i) => {
    for (const [other, b] of boxes.slice(i + 1)) {
      if (one.contains(other) || other.contains(one)) continue;
      const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (wide > 1 && high > 1) wrong.push(`${name(one)} and ${name(other)} overlap`);
    }
  });
  // Each one can be brought to where it is seen, and nothing lies on it there.
  for (const one of all) {
    one.scrollIntoView({ block: "nearest", inline: "nearest" });
    const { left, top, wide, high } = seen(one);
    const box = one.getBoundingClientRect();
    if (wide < Math.min(box.width, 20) - 1 || high < Math.min(box.height, 18) - 1 || high < 12) {
      wrong.push(`${name(one)} is ${Math.round(wide)} x ${Math.round(high)}`);
      continue;
    }
    const hit = document.elementFromPoint(left + wide / 2, top + high / 2);
    if (!hit || !(one.contains(hit) || hit.contains(one) || hit.closest("label")?.contains(one)))
      wrong.push(`${hit?.className || hit?.tagName} lies on ${name(one)}`);
  }
  for (const one of document.querySelectorAll(".header-items, .banners, .grid, dialog"))
    one.scrollTop = 0;
  return wrong;
}"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium(NO_GL) as running:
        yield running


@pytest.fixture
def played() -> Iterator[Played]:
    one = Played(4)
    with one:
        yield one


def _wrong(page: Any) -> list[str]:
    """What is wrong on a page as it is, on each of its tabs where it has some."""
    tabs = page.locator(".tabs button:visible").all()
    if page.locator("dialog[open]").count() or not tabs:
        found: list[str] = page.evaluate(LOOK)
        return found
    found = []
    for tab in tabs:
        tab.click()
        found += [f"{tab.inner_text()}: {one}" for one in page.evaluate(LOOK)]
    tabs[0].click()
    return found


@pytest.mark.parametrize(
    "sizes", [pytest.param(FEW, id="few"), pytest.param(SIZES, id="all", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("role", slow_but(ROLES[0].__eq__, ROLES))
def test_stop_is_seen_and_nothing_lies_on_anything(
    browser: Any, played: Played, role: str, device: str, sizes: list[tuple[int, int]]
) -> None:
    """On every screen, in every role, by mouse and touch: with alarms, with all robots stopped and
    a question open, and with a dialog open, which may lie on all but Stop."""
    with shown(browser, played.url(role), **DEVICES[device]) as page:
        page.wait_for_selector("[data-alarm]", state="attached")
        wrong: dict[tuple[object, ...], list[str]] = {}
        for state in ("plain", "stopped", "dialog"):
            if state == "stopped":
                played.gateway.stopped = True
                page.wait_for_selector("[data-stopped]")
            for width, height in sizes:
                if device == "touch" and width > 1366:
                    continue
                page.set_viewport_size({"width": width, "height": height})
                page.evaluate(
                    "new Promise((done) => requestAnimationFrame(() => setTimeout(done)))"
                )
                if state == "stopped" and role != "viewer":
                    _ask(page, played)
                if state == "dialog":
                    page.evaluate("document.querySelector('[data-do=keys]').click()")
                if found := _wrong(page):
                    wrong[state, width, height] = found
                if state == "dialog":
                    page.keyboard.press("Escape")
        assert not wrong, "\n".join(f"{where}: {what}" for where, what in wrong.items())


def _ask(page: Any, played: Played) -> None:
    """Have a question open, which goes by itself after a while."""
    if page.locator("[data-asked]").count() == 0:
        played.gateway.asked.append({"robot": "R1", "page": 99, "name": "Bob"})
        page.wait_for_selector("[data-asked]")


def test_text_grows_with_the_screen(browser: Any, played: Played) -> None:
    """On 3840 x 2160 px letters are twice as large as on 1920 x 1080, those on the map, too."""
    sizes = []
    for width, height in ((1920, 1080), (3840, 2160)):
        with shown(
            browser, played.url("operator"), viewport={"width": width, "height": height}
        ) as page:
            until(lambda page=page: page.evaluate("usarsim.map.drawn") > 2)
            sizes.append(
                page.evaluate(
                    """() => [".robot-name", ".estop", ".facts dt", "h2"].map((one) =>
                        parseFloat(getComputedStyle(document.querySelector(one)).fontSize))
                      .concat(parseFloat(/[0-9.]+px/.exec(document
                        .querySelector("[data-panel=map] canvas").getContext("2d").font)[0]))"""
                )
            )
    small, large = sizes
    assert large == pytest.approx([2 * size for size in small])
