# ruff: noqa: SIM117
"""Signals of robots by a wireless server, over sockets, and what becomes of them without one."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator

import pytest
from console_harness import gateway

from usarsim_operator.signals import DANGER_DBM, SAFE_DBM, grade
from usarsim_server.testing import running_server

MODEL = {"model": "distance", "reference_power": -85.0, "path_loss_exponent": 2.0,
         "reference_distance": 1.0}  # fmt: skip
"""At 2 m -91.02 dBm, at 3 m -94.54 dBm; all links are up."""


@pytest.fixture(scope="module")
def ports() -> Iterator[dict[str, int]]:
    """Of a server with a radio in which metres matter."""
    wireless = {**MODEL, "cutoff": -120.0}
    with running_server(world="empty", wireless_port=0, wireless=wireless) as (_, endpoints):
        yield {name: endpoint.port for name, endpoint in endpoints.items()}


def test_limits_of_the_station_that_competed() -> None:
    """-91 dBm is safe, -93 dBm the last of a link; unknown is no reason to warn."""
    assert (SAFE_DBM, DANGER_DBM) == (-91.0, -93.0)
    assert [grade(one) for one in (None, 0.0, -91.0, -91.1, -93.0, -93.1)] == [
        "good", "good", "good", "weak", "weak", "lost"]  # fmt: skip


async def test_signals_of_robots(ports: dict[str, int]) -> None:
    """By the formula of the model, and the state of the link with it; gone with the robot."""
    async with gateway(ports["control"], wireless=ports["wireless"]) as console:
        async with console.page() as page:
            for name, kind, x in (
                ("Near", "P3AT", 1.0),
                ("Middle", "P3AT", 2.2),
                ("Far", "P3AT", 4.0),
            ):
                place = [x, 0.0, -0.3]
                assert (await page.ask("spawn", **{"class": kind}, name=name, place=place))["ok"]
            await page.until(lambda: page.row("Far") and page.row("Far")["pose"])
            link = page.row("Far")["link"]
            assert (link["state"], link["signal_dbm"]) == ("good", None)  # there is no base yet
            base = {"class": "ComStation", "name": "ComStation", "place": [0.0, 0.0, -0.5]}
            assert (await page.ask("spawn", **base))["ok"]
            links = lambda: {one["name"]: one["link"] for one in page.state["robots"]}  # noqa: E731
            names = ("Near", "Middle", "Far")
            await page.until(lambda: all(links()[name]["signal_dbm"] for name in names))
            for name, state in zip(names, ("good", "weak", "lost"), strict=True):
                *place, _, _, _ = page.row(name)["pose"]
                away = math.dist(place, (0.0, 0.0, -0.5))
                told = links()[name]["signal_dbm"]
                assert told == pytest.approx(-85.0 - 20.0 * math.log10(away), abs=0.2)
                assert links()[name]["state"] == state
            assert links()["ComStation"]["signal_dbm"] is None
            for name, state in (("Middle", "weak"), ("Far", "lost")):
                told = await page.text(lambda one, name=name: (one.get("kind"), one.get("robot")) ==
                                       ("link", name))  # fmt: skip
                assert (told["value"], told["signal_dbm"]) == (state, links()[name]["signal_dbm"])
            await page.until(lambda: page.state["alarms"])
            (alarm,) = [one for one in page.state["alarms"] if one["kind"] == "link"]
            assert (alarm["robot"], "dBm" in alarm["text"]) == ("Far", True)
            # One that leaves and comes back registers anew.
            assert (await page.ask("remove", robot="Near"))["ok"]
            await page.until(lambda: page.row("Near") is None)
            again = {"class": "P3AT", "name": "Near", "place": [0.0, -3.0, -0.3]}
            assert (await page.ask("spawn", **again))["ok"]
            await page.until(
                lambda: ((page.row("Near") or {}).get("link") or {}).get("signal_dbm") is not None
            )
            assert links()["Near"]["signal_dbm"] == pytest.approx(-94.5, abs=0.2)


@pytest.mark.parametrize("how", ["refuses", "mute", "hangs up", "babbles"])
async def test_a_wireless_server_that_is_none(ports: dict[str, int], how: str) -> None:
    """Signals stay unknown and links good; robots drive as ever."""
    asked = 0

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal asked
        asked += 1
        if how == "babbles":
            writer.write(b"HTTP/1.0 400 {Strength 5} what?\r\n\r\n")
        if how != "hangs up":
            while await reader.read(100):
                pass
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    if how == "refuses":
        server.close()
    async with gateway(ports["control"], wireless=port) as console, console.page() as page:
        name = f"Alone {how}".replace(" ", "")
        place = [0.0, -5.0, -0.3]
        assert (await page.ask("spawn", **{"class": "P3AT"}, name=name, place=place))["ok"]
        await page.until(lambda: (page.row(name) or {}).get("pose"))
        await page.until(lambda: asked or how == "refuses")
        began = page.state["time"]
        await page.until(lambda: page.state["time"] > began + 1.2)
        link = page.row(name)["link"]
        assert (link["state"], link["signal_dbm"]) == ("good", None)
        assert asked <= 1  # it is not tried again and again
    server.close()
