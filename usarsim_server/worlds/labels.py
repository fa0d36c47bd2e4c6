"""Gives out the names of a world's robots, or of its people, so that no two are equal."""

from __future__ import annotations

from usarsim_server.base.errors import SpawnError
from usarsim_server.base.logs import Log
from usarsim_server.protocol.values import clean_name, free_name, name_key, taken


class Labels:
    """Names that differ whatever the case. The owner holds a lock meanwhile."""

    def __init__(self, area: str) -> None:
        """Nobody has a name yet; `area` names the lines in the log."""
        self._log = Log(area)
        self._taken: set[str] = set()

    def take(self, wish: str | None, otherwise: str, exact: bool = False) -> str:
        """A name of one's own, until it is given back: the wish, or else `otherwise`.

        It is cleaned and made unique, see `free_name`.

        Args:
            wish: None, or a text without a name in it, for no wish.
            otherwise: a name.
            exact: no other name than the wish will do.

        Raises:
            SpawnError: if it is too long, or would not be the exact one.
        """
        asked = wish is not None and clean_name(wish) != ""
        try:
            label = free_name(wish if asked and wish else otherwise, self._taken)
        except ValueError as error:
            raise SpawnError(str(error)) from None
        if exact and asked and label != wish:
            clean = clean_name(wish or "")
            if clean.lower() in self._taken:
                raise SpawnError(taken(clean))
            raise SpawnError(f"no name has blanks, braces or what cannot be printed: write {clean}")
        self._taken.add(name_key(label))
        if asked and label != wish:
            self._log.warning("a client gets another name than it asked for", asked=wish, got=label)
        return label

    def give_back(self, label: str) -> None:
        """Somebody else may have the name now."""
        self._taken.discard(name_key(label))
