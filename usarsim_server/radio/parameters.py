"""Reads the table of radio settings; reading a key is what declares it."""

from __future__ import annotations

import math
from collections.abc import Mapping

from usarsim_server.errors import SettingsError, at
from usarsim_server.tables import finite


class RadioParameters:
    """Checked access to the keys of one table.

    All readers return the default when the key is absent and raise `SettingsError` when its value
    cannot be used.
    """

    def __init__(self, table: Mapping[str, object], place: str) -> None:
        """Read from a table.

        Args:
            table: as it was parsed; hyphens count as underscores.
            place: where it stands, for errors.
        """
        self._table = {key.replace("-", "_"): value for key, value in table.items()}
        self._place = place
        self._known: dict[str, None] = {}

    @property
    def place(self) -> str:
        """Where the table stands."""
        return self._place

    def number(
        self,
        key: str,
        default: float,
        *,
        low: float = -math.inf,
        high: float = math.inf,
        above: float = -math.inf,
    ) -> float:
        """A finite number in [low, high] that is also greater than `above`."""
        value = self._value(key)
        if value is None:
            return default
        number = finite(value)
        if number is None or not (low <= number <= high and number > above):
            cure = f"write a number{_limits(low, high, above)}, for example {key} = {default:g}"
            raise self.error(key, f"{value!r} does not fit", cure)
        return number

    def count(self, key: str, default: int, *, low: int, high: int) -> int:
        """A whole number in [low, high]."""
        value = self._value(key)
        if value is None:
            return default
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            cure = f"write a whole number from {low} to {high}"
            raise self.error(key, f"{value!r} does not fit", cure)
        return value

    def text(self, key: str, default: str) -> str:
        """A text."""
        value = self._value(key)
        if value is None:
            return default
        if not isinstance(value, str):
            raise self.error(key, f"{value!r} is no text", f'write {key} = "{default}"')
        return value

    def error(self, key: str, problem: str, cure: str) -> SettingsError:
        """The error to raise for a key."""
        return SettingsError(at(self._place, problem, cure, where=key))

    def finish(self) -> None:
        """Raise `SettingsError` if the table has a key that nobody read."""
        for key in self._table:
            if key not in self._known:
                known = ", ".join(sorted(self._known))
                raise self.error(key, "no such setting of this model", f"known keys: {known}")

    def _value(self, key: str) -> object:
        self._known[key] = None
        return self._table.get(key)


def _limits(low: float, high: float, above: float) -> str:
    parts = []
    if above > -math.inf:
        parts.append(f"above {above:g}")
    elif low > -math.inf:
        parts.append(f"of at least {low:g}")
    if high < math.inf:
        parts.append(f"of at most {high:g}")
    return " " + " and ".join(parts) if parts else ""
