"""What is closed at the end of a `with` block, whatever else it is."""

from __future__ import annotations

from typing import Self


class Closing:
    """Something that is closed at the end of a `with` block."""

    def close(self) -> None:
        """End it."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
