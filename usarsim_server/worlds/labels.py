"""Who is called what: the names of all robots of a world, or of all its people."""

from __future__ import annotations

from usarsim_server.errors import SpawnError
from usarsim_server.logs import Log
from usarsim_server.protocol.values import clean_name, free_name, name_key


class Labels:
    """Names that differ whatever the case. The owner holds a lock meanwhile."""

    def __init__(self, area: str) -> None:
        """Nobody has a name yet.

        Args:
            area: names the lines in the log.
        """
        self._log = Log(area)
        self._taken: set[str] = set()

    def take(self, wish: str | None, otherwise: str) -> str:
        """A name of one's own, until it is given back.

        Args:
            wish: what a client asked for; cleaned and made unique, see `free_name`.
            otherwise: what is made unique instead if nothing was asked for.

        Raises:
            SpawnError: if it is too long.
        """
        asked = wish is not None and clean_name(wish) != ""
        try:
            label = free_name(wish if asked and wish else otherwise, self._taken)
        except ValueError as error:
            raise SpawnError(str(error)) from None
        self._taken.add(name_key(label))
        if asked and label != wish:
            self._log.warning("a client gets another name than it asked for", asked=wish, got=label)
        return label

    def give_back(self, label: str) -> None:
        """Somebody else may have the name now."""
        self._taken.discard(name_key(label))
