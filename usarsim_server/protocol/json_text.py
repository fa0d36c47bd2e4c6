"""Reads JSON that others may have written: whatever is wrong with it is one kind of error."""

from __future__ import annotations

import json
from typing import Any


def parse_json(text: str | bytes, *, finite: bool = False) -> Any:
    """The value of a JSON text.

    Args:
        text: the text. finite: NaN and infinities, which are no JSON, are refused as well.

    Raises:
        ValueError: it is none, is nested deeper than Python can read, or has numbers of thousands
            of digits.
    """
    try:
        return json.loads(text, parse_constant=_refused if finite else None)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _refused(constant: str) -> float:
    raise ValueError(f"{constant} is no number of JSON")
