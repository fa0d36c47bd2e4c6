"""The data of a shared run: a table of contents and arrays of numbers, compressed.

    gzip of: length of the contents (uint32), contents (JSON, UTF-8), spaces up to a multiple of 4,
    then each array of the contents' list `arrays` in turn, filled up to a multiple of 4

All little-endian. An array is `[name, type, count]`: `u1` bytes as they are, `i4` int32 of which
each number but the first is the difference to the one before it. The page undoes it (`packed.ts`).
"""

from __future__ import annotations

import gzip
import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = Mapping[str, NDArray[np.int32] | NDArray[np.uint8]]


def pack(contents: Mapping[str, Any], arrays: Arrays) -> bytes:
    """Contents and arrays as bytes.

    Args:
        contents: plain values without NaN. arrays: by name, int32 or uint8.
    """
    table, parts = [], []
    for name, array in arrays.items():
        if array.dtype == np.uint8:
            kind, data = "u1", array.tobytes()
        else:
            kind, data = "i4", np.diff(array, prepend=0).astype("<i4").tobytes()
        table.append([name, kind, len(array)])
        parts.append(data + b"\0" * (-len(data) % 4))
    told = {**contents, "arrays": table}
    text = json.dumps(told, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    return gzip.compress(struct.pack("<I", len(text)) + text + b"".join(parts), 6, mtime=0)
