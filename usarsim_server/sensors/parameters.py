"""Reads the free keys of one `[[sensor]]` table; reading a key is what declares it.

Every mistake in a robot file becomes one `RobotDescriptionError` that names the file, the item, the
key and the cure. Keys that nobody read are mistakes too (`finish`).
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence

from usarsim_server.errors import RobotDescriptionError, at
from usarsim_server.robots.description import ItemDescription
from usarsim_server.tables import finite


class Parameters:
    """Checked access to the parameters of one item.

    All readers return the default when the key is absent and raise `RobotDescriptionError` when
    its value cannot be used.
    """

    def __init__(self, item: ItemDescription) -> None:
        self._item = item
        self._known: list[str] = []

    def number(
        self,
        key: str,
        default: float,
        *,
        minimum: float = -math.inf,
        maximum: float = math.inf,
        above: float = -math.inf,
    ) -> float:
        """A finite number in [minimum, maximum] that is also greater than `above`."""
        value = self._value(key)
        if value is None:
            return default
        example = f"for example {key} = {default:g}"
        number = finite(value)
        if number is None:
            problem = f"{value!r} is not a finite number"
            raise self.error(key, problem, f"write a number, {example}")
        if not minimum <= number <= maximum or number <= above:
            cure = f"write a number{_limits(minimum, maximum, above)}, {example}"
            raise self.error(key, f"{value!r} is out of range", cure)
        return number

    def optional_number(self, key: str, *, minimum: float) -> float | None:
        """A finite number of at least `minimum`, or None if the key is absent."""
        return self.number(key, minimum, minimum=minimum) if self._has(key) else None

    def count(self, key: str, default: int, *, minimum: int, maximum: int) -> int:
        """A whole number in [minimum, maximum]."""
        value = self._value(key)
        if value is None:
            return default
        if isinstance(value, bool) or not isinstance(value, int) or not minimum <= value <= maximum:
            raise self.error(
                key,
                f"{value!r} is not a whole number from {minimum} to {maximum}",
                f"for example {key} = {default}",
            )
        return value

    def flag(self, key: str, default: bool) -> bool:
        """A boolean."""
        value = self._value(key)
        if value is None:
            return default
        if not isinstance(value, bool):
            raise self.error(
                key, f"{value!r} is neither true nor false", f"write {key} = true or {key} = false"
            )
        return value

    def choice(self, key: str, default: str, options: Sequence[str]) -> str:
        """One of a few words, compared without case, returned as `options` spells it."""
        value = self._value(key)
        if value is None:
            return default
        for option in options:
            if isinstance(value, str) and value.strip().lower() == option.lower():
                return option
        words = " or ".join(f'"{option}"' for option in options)
        raise self.error(key, f"{value!r} is not known", f"write {key} = {words}")

    def raw(self, key: str) -> object:
        """The value as it stands in the file, or None; the caller checks it."""
        return self._value(key)

    def error(self, key: str, problem: str, cure: str) -> RobotDescriptionError:
        """The error to raise for a key of this item."""
        return RobotDescriptionError(at(self._place(), problem, cure, where=key))

    def finish(self) -> None:
        """Raise `RobotDescriptionError` if the table has a key that nobody read."""
        for key in self._item.parameters:
            if key in self._known:
                continue
            near = difflib.get_close_matches(key.lower(), self._known, n=1)
            known = ", ".join(sorted(self._known))
            hint = f"write {near[0]}" if near else "remove it"
            raise self.error(
                key, f"unknown key of a {self._item.type}", f"{hint}; known keys: {known}"
            )

    def _has(self, key: str) -> bool:
        return self._value(key) is not None

    def _value(self, key: str) -> object:
        if key not in self._known:
            self._known.append(key)
        return self._item.parameters.get(key)

    def _place(self) -> str:
        return self._item.where or f"sensor {self._item.name}"


def _limits(minimum: float, maximum: float, above: float) -> str:
    parts = []
    if above > -math.inf:
        parts.append(f"greater than {above:g}")
    elif minimum > -math.inf:
        parts.append(f"of at least {minimum:g}")
    if maximum < math.inf:
        parts.append(f"of at most {maximum:g}")
    return " " + " and ".join(parts) if parts else ""
