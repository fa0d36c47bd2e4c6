"""Feeds of all cameras of a station, and of its spectator picture: as many as somebody looks at."""

from __future__ import annotations

from typing import TYPE_CHECKING

from usarsim_client import Robot
from usarsim_client.cameras import Pictures, Tile
from usarsim_client.link import Address
from usarsim_operator.pictures import FULL_RATE, HASTY_RATE, SLOW_RATE, CameraFeed, look_at

if TYPE_CHECKING:
    from usarsim_operator.robot_link import Driven
    from usarsim_operator.shows import Shows
    from usarsim_operator.station import Station

_PATIENCE = 5.0  # s of wall time that the image port may take


class CameraFeeds:
    """By the names of their robots."""

    def __init__(self, station: Station, shows: Shows) -> None:
        """shows: hands the pictures on."""
        self._station, self._shows = station, shows
        self._feeds: dict[str, CameraFeed] = {}
        self._spectator: CameraFeed | None = None

    def __len__(self) -> int:
        return len(self._feeds)

    def get(self, robot: str) -> CameraFeed | None:
        """The feed of a robot; None if it has no camera."""
        return self._feeds.get(robot)

    def begin(self) -> None:
        """Look at the world from outside, if the server shows it."""
        if (tile := self._station.settings.spectator) is not None:
            self._spectator = CameraFeed(lambda: self._whole(tile), self._shows.spectator)

    def add(self, driven: Driven, robot: Robot) -> None:
        """Look through the camera of a robot."""
        grid, name = self._station.settings.tiles, driven.camera

        def show(data: bytes, count: int) -> None:
            self._shows.picture(driven, data, count)

        self._feeds[driven.name] = CameraFeed(lambda: look_at(robot, name, grid, self._whole), show)

    async def forget(self, robot: str) -> None:
        """A robot has left."""
        if (feed := self._feeds.pop(robot, None)) is not None:
            await feed.close()

    def want(self) -> None:
        """Ask for what somebody looks at, no more; of a robot whose link is cut, nothing."""
        viewers = self._station.pages.values()
        cut = {one.name for one in self._station.robots.values() if one.cut}
        most = HASTY_RATE if self._station.hasty else FULL_RATE
        chosen = {page.selected for page in viewers}
        # What pages are about is asked for first.
        for name, feed in sorted(self._feeds.items(), key=lambda one: one[0] not in chosen):
            pages = [one for one in viewers if name not in {*one.cameras_off, *cut}]
            closely = any(page.selected == name for page in pages)
            feed.want(0.0 if not pages else min(most, FULL_RATE if closely else SLOW_RATE))
        if self._spectator is not None:
            blind = any(one.role.sees_truth and not one.draws for one in viewers)
            self._spectator.want(SLOW_RATE if blind else 0.0)

    async def close(self) -> None:
        """Let all of them go."""
        for feed in (*self._feeds.values(), *filter(None, (self._spectator,))):
            await feed.close()

    def _whole(self, tile: Tile | None = None) -> Pictures:
        """Look at the image port itself."""

        async def find() -> Tile | None:
            return tile

        settings = self._station.settings
        return Pictures(Address(settings.host, settings.image_port, _PATIENCE), find, 0.0)
