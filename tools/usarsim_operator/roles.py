"""Who may look and who may act: tokens of three roles, and how much a page may say."""

from __future__ import annotations

import secrets
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum

LONGEST = 64 * 1024
"""Bytes of a text of a page."""
TEXTS = 200.0
"""Texts of a page a second."""
CHARACTERS = 128 * 1024.0
"""Characters of texts of a page a second; twice as many at once."""
DRIVES = 60.0
"""Texts of a page a second that drive."""
ASKS, ASKS_AT_ONCE = 10.0, 64.0
"""Texts of a viewer's page a second, and at once, all but `shown`, which a page sends dozens of."""
PINGS, PINGS_AT_ONCE = 4.0, 16.0
"""Pings of a page a second, and at once, that are kept and measured; all are answered."""
REFUSALS = 400
"""Texts of a page that were too many or made no sense, after which it is shut out."""


class Role(Enum):
    """What a page may see and do."""

    OPERATOR = "operator"
    INSTRUCTOR = "instructor"
    VIEWER = "viewer"

    @property
    def sees_truth(self) -> bool:
        """Whether the true world is shown."""
        return self is not Role.OPERATOR

    def may(self, kind: str) -> bool:
        """Whether a text of a kind is heard at all."""
        if kind in _ALL:
            return True
        if self is Role.VIEWER:
            return False
        return self is Role.INSTRUCTOR or kind not in _INSTRUCTOR


_ALL = frozenset({"hello", "ping", "shown", "ready", "select", "camera", "laser"})
_INSTRUCTOR = frozenset({"pace", "lines", "inject", "load", "close"})


class Tokens:
    """A secret for each role, and one for each further seat of an operator."""

    def __init__(self, kept: Mapping[Role, str] | None = None, seats: int = 1) -> None:
        """kept: those of an earlier gateway; None: new ones. seats: how many operators there are,
        each of whom the token tells; any number of pages may share one."""
        self._by_role = kept or {role: secrets.token_urlsafe(18) for role in Role}
        self._seats = {(role, 0): secret for role, secret in self._by_role.items()}
        self._seats[Role.OPERATOR, 1] = self._seats.pop((Role.OPERATOR, 0))
        for seat in range(2, seats + 1):
            self._seats[Role.OPERATOR, seat] = secrets.token_urlsafe(18)

    def __getitem__(self, role: Role) -> str:
        return self._by_role[role]

    def all(self) -> Iterator[tuple[str, str]]:
        """Each with who it is for: `operator` (of several `operator 1`, ...), `instructor`,
        `viewer`."""
        operators = sum(role is Role.OPERATOR for role, _ in self._seats)
        for (role, seat), secret in sorted(self._seats.items(), key=lambda one: one[0][1]):
            if role is Role.OPERATOR:
                yield (role.value if operators == 1 else f"{role.value} {seat}"), secret
        for role in (Role.INSTRUCTOR, Role.VIEWER):
            yield role.value, self._by_role[role]

    def role(self, token: object) -> Role | None:
        """The role of a token; None for what is none."""
        found = self.seat(token)
        return None if found is None else found[0]

    def seat(self, token: object) -> tuple[Role, int] | None:
        """Role and seat of a token; None for what is none. Takes equally long for all of them."""
        if not isinstance(token, str):
            return None
        given, found = token.encode("utf-8", "replace"), None
        for seat, secret in self._seats.items():
            if secrets.compare_digest(given, secret.encode()):
                found = seat
        return found

    def of_header(self, header: str | None) -> Role | None:
        """The role of an `Authorization: Bearer` header."""
        scheme, _, token = (header or "").partition(" ")
        return self.role(token.strip()) if scheme.lower() == "bearer" else None


@dataclass(slots=True)
class _Bucket:
    """Lets through so many a second, and so many at once."""

    rate: float
    most: float
    last: float
    left: float = field(init=False)

    def __post_init__(self) -> None:
        self.left = self.most

    def take(self, now: float, count: float = 1.0) -> bool:
        self.left = min(self.most, self.left + (now - self.last) * self.rate)
        self.last = now
        if self.left < count:
            return False
        self.left -= count
        return True


class Limits:
    """How much one page has said; times are s of the gateway's clock.

    Attributes:
        refused: texts that were not heard.
    """

    def __init__(self, now: float) -> None:
        self.refused = 0
        self._texts = _Bucket(TEXTS, TEXTS, now)
        self._characters = _Bucket(CHARACTERS, 2.0 * CHARACTERS, now)
        self._drives = _Bucket(DRIVES, DRIVES, now)
        self._asks = _Bucket(ASKS, ASKS_AT_ONCE, now)
        self._pings = _Bucket(PINGS, PINGS_AT_ONCE, now)

    def hears(self, now: float, size: int = 0) -> bool:
        """Whether one more text of so many characters is read."""
        return (self._texts.take(now) and self._characters.take(now, size)) or self.refuse()

    def asks(self, now: float) -> bool:
        """Whether one more text of a viewer but `shown` is read."""
        return self._asks.take(now) or self.refuse()

    def measures(self, now: float) -> bool:
        """Whether one more ping is kept and measured; those beyond are answered all the same."""
        return self._pings.take(now)

    def drives(self, now: float) -> bool:
        """Whether one more text that drives is obeyed."""
        return self._drives.take(now) or self.refuse()

    def refuse(self) -> bool:
        """Count a text that is not heard; always False."""
        self.refused += 1
        return False

    @property
    def exhausted(self) -> bool:
        """Whether the page is to be shut out."""
        return self.refused > REFUSALS
