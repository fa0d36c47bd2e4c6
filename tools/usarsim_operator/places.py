"""Counts the places of pages that have said hello; some are kept for operators."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, TypeVar

PageLike = TypeVar("PageLike")


class NoPlaceError(ValueError):
    """All places are taken by pages that come first."""


class PagePlaces(Generic[PageLike]):
    """Keeps which pages have a place, and which of them has been silent longest."""

    def __init__(self, most: int, kept: int) -> None:
        """most: places. kept: how many of them are only for pages that lead."""
        self._most, self._kept = most, kept
        self._pages: dict[PageLike, bool] = {}  # whether they lead; the longest silent first

    def __len__(self) -> int:
        return len(self._pages)

    def __iter__(self) -> Iterator[PageLike]:
        return iter(tuple(self._pages))

    def __contains__(self, page: PageLike) -> bool:
        return page in self._pages

    def enter(self, page: PageLike, *, leads: bool) -> PageLike | None:
        """Give a page a place.

        Args:
            page: new here. leads: whether kept places are for it.

        Returns:
            The page that has lost its own by that: the longest silent one, of those that do not
            lead if there are any; None if there was a place left.

        Raises:
            NoPlaceError: it does not lead, and all others do.
        """
        others = [one for one, first in self._pages.items() if not first]
        lost: PageLike | None = None
        full = len(self._pages) >= self._most
        if full or (not leads and len(others) >= self._most - self._kept):
            crowd = others or (list(self._pages) if leads else [])
            if not crowd:
                raise NoPlaceError("all places are taken")
            lost = crowd[0]
            del self._pages[lost]
        self._pages[page] = leads
        return lost

    def heard(self, page: PageLike) -> None:
        """A page said something."""
        if (leads := self._pages.pop(page, None)) is not None:
            self._pages[page] = leads

    def leave(self, page: PageLike) -> None:
        """A page has gone; it may have lost its place before."""
        self._pages.pop(page, None)
