"""The page: its own tests, its build and size, and what it does in a real browser."""

import asyncio
import gzip
import hashlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytest.importorskip("aiohttp")

from console_browser import NO_GL, opened
from fake_gateway import FakeGateway

WEB = Path(__file__).parents[2] / "tools" / "usarsim_operator" / "web"


def hashes(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()}


@pytest.mark.parametrize("script", ["test", "types", "lint"])
def test_the_page_passes_its_own_tests(npm: Callable[..., Any], script: str) -> None:
    """O-29 to O-32, O-35, O-36, CON-08, CON-18 to CON-20, CON-27: node's test runner; style."""
    done = npm("run", script)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]


def test_two_builds_are_identical_and_small(
    page_folder: Path, builder: ModuleType, npm: Callable[..., Any], tmp_path: Path
) -> None:
    """CON-03, CON-04: byte-identical, at most 300 kB compressed: the pages that go over a network,
    that is all but what `usarsim share` puts into a file, which no gateway's page asks for."""
    assert npm("run", "build", "--", str(tmp_path / "page")).returncode == 0
    assert hashes(page_folder) == hashes(tmp_path / "page")
    assert builder.is_fresh(WEB, page_folder)
    served = [p for p in page_folder.iterdir() if p.stem != "share"]
    size = sum(len(gzip.compress(p.read_bytes())) for p in served)
    assert size <= 300_000


def run(scenario: Any, robots: int = 4, role: str = "instructor", **options: Any) -> None:
    """Plays a scenario, a coroutine of page and gateway, in the browser."""

    async def play() -> None:
        gateway = FakeGateway(robots, options.pop("names", None))
        async with gateway.serve() as port, opened(port, role, **options) as page:
            await scenario(page, gateway)

    asyncio.run(play())


async def until(check: Any, within_s: float = 20.0) -> None:
    for _ in range(int(within_s / 0.05)):
        if check():
            return
        await asyncio.sleep(0.05)
    raise AssertionError("it did not come about")


@pytest.mark.usefixtures("page_folder")
class TestInBrowser:
    def test_frozen_input_grows_stale(self) -> None:
        """CON-19: every tile, map, laser and the card say so."""

        async def scenario(page: Any, gateway: FakeGateway) -> None:
            await page.wait_for_selector('[data-tile="R1"][data-stale="false"]')
            gateway.frozen = True
            for what in ("[data-tile]", "[data-panel=laser]", "[data-panel=card]", ".robot-row"):
                await page.wait_for_selector(f'{what}[data-stale="true"]')
            await page.wait_for_function("!document.querySelector('[data-tile][data-stale=false]')")

        run(scenario)

    @pytest.mark.parametrize("robots", [4, 16])
    def test_tiles_choice_and_stop(self, robots: int) -> None:
        """O-20, O-25, CON-15: n tiles; digits choose; Escape twice stops all."""

        async def scenario(page: Any, gateway: FakeGateway) -> None:
            assert await page.locator("[data-tile]").count() == robots
            await page.keyboard.press("3")
            await page.wait_for_selector('[data-tile="R3"][aria-pressed="true"]')
            await page.keyboard.press("Escape")
            await page.keyboard.press("Escape")
            await until(lambda: gateway.stopped)

        run(scenario, robots)

    def test_without_webgl_all_else_works(self) -> None:
        """CON-24: the 3D tile shows the gateway's picture."""

        async def scenario(page: Any, gateway: FakeGateway) -> None:
            await page.wait_for_selector('[data-panel="view3d"][data-webgl="false"]')
            await page.wait_for_function("document.querySelector('[data-spectator]').width === 320")

        run(scenario, flags=NO_GL)
