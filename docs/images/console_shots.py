"""Makes the pictures of the operator console for README and docs/console.md, out of real runs.

Needs the console's extra, playwright, Chromium and Pillow: ``python docs/images/console_shots.py
[NAME...]``. Each picture is a run of its own: a server, `usarsim console` with its robots, and a
browser that drives them by its keys.
"""

import asyncio
import io
import os
import re
import socket
import subprocess
import sys
import tempfile
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.async_api import async_playwright

HERE = Path(__file__).parent
LARGEST = 250_000
FLAGS = ["--use-angle=gl-egl", "--ignore-gpu-blocklist", "--no-sandbox"]
CLASSES = (
    "P3AT P2DX Talon AirRobot Kenaf P3AT P2DX TeleMax P3AT ATRVJr P3AT Zerg P2DX P3AT Talon P3AT"
)
DESKTOP = {"width": 1366, "height": 768}
LARGE = {"width": 1600, "height": 900}
PHONE = {"width": 390, "height": 844}

Play = Callable[[Any, int], Awaitable[None]]


def free_ports(count: int) -> list[int]:
    """Ports that nobody has at the moment."""
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


@contextmanager
def running(world: str, classes: list[str]) -> Iterator[tuple[int, dict[str, str]]]:
    """A server and a console with robots R1, R2, ...: the port of the server and a URL per role."""
    port, images, scene = free_ports(3)
    usarsim = [sys.executable, "-m", "usarsim_server"]
    asked = ["serve", "--world", world, "--port", port, "--image-port", images, "--camera-rate", 5]
    asked += ["--groundtruth-port", 0, "--wireless-port", 0, "--truth-port", 0]
    asked += ["--scene-port", scene, "--scene-token", "shots", "--supervise", "on"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
    with tempfile.TemporaryDirectory() as folder:
        server: Any = subprocess.Popen([*usarsim, *map(str, asked)], **pipes)  # type: ignore[call-overload]
        until(server, "READY")
        asked = ["console", "--connect", f"127.0.0.1:{port}", "--image-port", images]
        asked += ["--scene-port", scene, "--scene-token", "shots", "--console-port", 0]
        asked += ["--no-browser", "--viewer-delay", 0, "--latch", f"{folder}/latch.json"]
        for n, name in enumerate(classes, 1):
            asked += ["--robot", f"{name}=R{n}"]
        console: Any = subprocess.Popen([*usarsim, *map(str, asked)], **pipes)  # type: ignore[call-overload]
        try:
            urls = re.findall(r"CONSOLE (\S+) (\w+)", until(console, "viewer"))
            yield port, {role: url for url, role in urls}
        finally:
            for process in (console, server):
                process.terminate()
                process.wait(20)


def until(process: Any, word: str) -> str:
    """What a process prints, up to the line with a word."""
    said = ""
    for line in process.stdout:
        said += line
        if word in line:
            return said
    raise SystemExit(f"it ended before it said {word}: {said}")


async def hold(page: Any, keys: str, seconds: float) -> None:
    """Drive the chosen robot for simulated seconds."""
    start = await page.evaluate("usarsim.store.state.time")
    for key in keys:
        await page.keyboard.down(key)
    await page.wait_for_function(
        "([t, s]) => usarsim.store.state.time > t + s", arg=[start, seconds], timeout=120_000
    )
    for key in keys:
        await page.keyboard.up(key)


async def settle(page: Any) -> None:
    """Wait until every picture is fresh, nothing moves, and the 3D view is sharp."""
    await page.wait_for_timeout(1500)
    fresh = "() => !document.querySelector('[data-tile][data-camera=on][data-stale=true]')"
    sharp = "() => document.querySelector('[data-panel=view3d]').dataset.sharp !== 'false'"
    heard = "() => !document.querySelector('[data-panel=laser][data-laser=on][data-stale=true]')"
    for check in (sharp, fresh, heard):
        await page.wait_for_function(check, timeout=60_000)
    await page.mouse.move(2, 2)
    await page.evaluate("document.activeElement?.blur()")


async def tour(page: Any, robots: int) -> None:
    """Let some robots drive about, so that there is something to see."""
    for n in range(robots, 0, -1):
        await page.keyboard.press(str(n))
        await hold(page, "w", 2.5)
        await hold(page, "wd" if n % 2 else "wa", 1.0)
        await hold(page, "w", 1.5)


async def four(page: Any, port: int) -> None:
    await tour(page, 4)


async def sixteen(page: Any, port: int) -> None:
    await tour(page, 3)


async def laser3d(page: Any, port: int) -> None:
    await page.keyboard.press("1")
    await page.click("[data-panel=laser] [data-do=choose-points]")
    await page.click("[data-panel=view3d] [data-do=choose-follow]")


async def instructor(page: Any, port: int) -> None:
    await tour(page, 2)
    await page.click("[data-panel=view3d] [data-do=choose-follow]")
    await settle(page)
    await page.click("[data-do=pause]")
    await page.wait_for_selector("[data-world=paused]")


async def lines(page: Any, port: int) -> None:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)

    async def drain() -> None:
        while await reader.read(65536):
            pass

    drained = asyncio.create_task(drain())
    writer.write(b"INIT {ClassName USARBot.P3AT} {Name Legacy} {Start RobotStart5}\r\n")
    row = page.locator('[data-robot="Legacy"]')
    await row.wait_for(timeout=60_000)
    await row.click()
    await page.click("[data-do=choose-lines]")
    await page.wait_for_timeout(1000)
    for line in (
        "INIT {ClassName USARBot.P3TA} {Name Second}",
        "DRIVE {Left 2.0} {Right 2.0}",
        "DRIVE {Left abc} {Rihgt 1.0}",
        "SET {Type Camera} {Opcode Zoom} {Params 1.0}",
        "DRIVEN {Left 1.0} {Right 1.0}",
        "DRIVE {Left 1.0} {Right 1.0} {Light true}",
    ):
        writer.write(line.encode() + b"\r\n")
        await page.wait_for_timeout(700)
    await page.wait_for_selector("[data-lines] [data-fault=true]")
    await page.wait_for_timeout(1500)
    drained.cancel()


async def phone(page: Any, port: int) -> None:
    await hold(page, "w", 4.0)


SHOTS: dict[str, tuple[str, str, list[str], dict[str, int], str, Play]] = {
    "four": ("arena", "operator", CLASSES.split()[:4], DESKTOP, "light", four),
    "sixteen": ("arena", "instructor", CLASSES.split(), LARGE, "dark", sixteen),
    "laser3d": ("office", "instructor", ["KinectBot", "P3AT"], DESKTOP, "dark", laser3d),
    "instructor": ("arena", "instructor", CLASSES.split()[:4], DESKTOP, "light", instructor),
    "lines": ("arena", "instructor", CLASSES.split()[:2], LARGE, "light", lines),
    "phone": ("arena", "operator", CLASSES.split()[:4], PHONE, "dark", phone),
}


async def shoot(name: str) -> None:
    """Make one picture."""
    world, role, classes, size, theme, play = SHOTS[name]
    with running(world, classes) as (port, urls):
        async with async_playwright() as tools:
            browser = await tools.chromium.launch(
                executable_path="/usr/bin/chromium",
                args=FLAGS,
                env={**os.environ, "LIBGL_ALWAYS_SOFTWARE": "1"},
            )
            small = size["width"] < 700
            page = await browser.new_page(
                viewport=size, color_scheme=theme, has_touch=small, device_scale_factor=1 + small
            )
            await page.goto(urls[role])
            await page.wait_for_selector("[data-tile]", timeout=120_000)
            await play(page, port)
            if name not in ("instructor", "lines"):
                await settle(page)
            save(await page.screenshot(), HERE / f"console-{name}.png")
            await browser.close()


def save(png: bytes, path: Path) -> None:
    """Write a picture, with a palette where it would be too large without."""
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    for colours in (0, 256, 128, 64):
        out = io.BytesIO()
        shown = picture.quantize(colours, kmeans=1) if colours else picture
        shown.save(out, "PNG", optimize=True)
        if out.tell() < LARGEST:
            break
    path.write_bytes(out.getvalue())
    print(f"{path.name}: {picture.width}x{picture.height}, {out.tell() / 1000:.0f} kB")


if __name__ == "__main__":
    for shot in sys.argv[1:] or SHOTS:
        asyncio.run(shoot(shot))
