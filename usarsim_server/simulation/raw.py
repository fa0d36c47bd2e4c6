"""Compiled models made of rows of numbers, without MuJoCo's compiler.

An `mjModel` is a struct of sizes, options and pointers, and one block of memory with all arrays, in
an order that the package tells (`mujoco.introspect`). `RawModel` takes a model apart and makes one
of other rows: memory by MuJoCo's allocator, filled once; MuJoCo gives it back as that of any model.
Going by its binary form (`mj_saveModel`) takes five copies instead of one.

Where the struct lies otherwise than expected, in another version of MuJoCo or on another system,
`understood` says no, and nobody may use the rest.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Collection
from ctypes import c_int, c_size_t, c_uint8, c_void_p
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

Rows = NDArray[Any]

_ALIGNED = 64
"""Bytes: every array begins at a multiple of it."""
_WORD = 8
_PAGE = 2 << 20
"""Bytes of a large page of memory, as Linux has them."""
_NAMES_OF_MANY = ("name_geomadr", "name_meshadr")
"""Where names begin of what there is most of."""
_LARGE_PAGES = 14
"""MADV_HUGEPAGE: a model of 200 MB has 55,000 small pages, and each costs the kernel some time."""
_SAMPLE = """<mujoco><asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset><worldbody>
<geom name="floor" type="plane" size="1 1 1"/><geom name="a" type="mesh" mesh="m"/>
<body><freejoint/><geom name="b" size="1"/></body></worldbody></mujoco>"""


@cache
def fields() -> tuple[tuple[str, ...], dict[str, str]]:
    """Names of all sizes of a model, and of all arrays with the size that counts their rows; in
    MuJoCo's order."""
    from mujoco.introspect.structs import STRUCTS

    every = STRUCTS["mjModel"].fields
    sizes = tuple(one.name for one in every if getattr(one.type, "name", "") == "mjtSize")
    return sizes, {one.name: str(one.array_extent[0]) for one in every if one.array_extent}


def rows_of(model: mujoco.MjModel, name: str) -> Rows:
    """An array of a model, no copy; text as numbers of its bytes."""
    rows = getattr(model, name)
    return np.frombuffer(rows, np.uint8) if isinstance(rows, bytes) else rows


@dataclass(slots=True)
class RawModel:
    """A model taken apart.

    Attributes:
        sizes: by name. rows: pieces of each array, which follow on one another.
    """

    sizes: dict[str, int]
    rows: dict[str, list[Rows]]
    _struct: NDArray[np.uint64]  # of the model, as words
    _block: int  # which of them points to the block of arrays; pointers to each follow

    @classmethod
    def of(cls, model: mujoco.MjModel) -> RawModel:
        """Take a model apart; its rows are those of the model, not copies of them.

        Raises:
            ValueError: the struct does not lie in memory as expected.
        """
        names, arrays = fields()
        sizes = [int(getattr(model, name)) for name in names]
        rows = {name: rows_of(model, name) for name in arrays}
        block = _pointers(model, rows)
        words = _words(model._address, block + 2 + len(arrays))
        if (
            words[: len(names)].view(np.int64).tolist() != sizes
            or int(words[-1]) != model.signature
        ):
            raise ValueError("sizes of a model do not lie as expected")
        pieces = {name: [one] for name, one in rows.items()}
        return cls(dict(zip(names, sizes, strict=True)), pieces, words.copy(), block)

    def whole(self, name: str) -> Rows:
        """An array of the model in one piece; no copy if it is in one."""
        pieces = self.rows[name]
        return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)

    def model(self, lent: Collection[str] = ()) -> mujoco.MjModel:
        """Make a model of the sizes and rows.

        Args:
            lent: arrays in one piece that are not copied. Whoever owns them has to live longer.

        Raises:
            MemoryError: there is no room for it.
        """
        own = {name: pieces for name, pieces in self.rows.items() if name not in lent}
        places, end = {}, 0
        for name, pieces in own.items():
            places[name] = -(-end // _ALIGNED) * _ALIGNED
            end = places[name] + sum(piece.nbytes for piece in pieces)
        self.sizes["nbuffer"] = end + _ALIGNED - 1
        block, struct = _allocated(end + _ALIGNED - 1), _allocated(self._struct.nbytes)
        _ask_for_large_pages(block, end)
        first = -(-block // _ALIGNED) * _ALIGNED
        memory = np.ctypeslib.as_array((c_uint8 * end).from_address(first))
        for name, pieces in own.items():
            place = places[name]
            for piece in pieces:
                into = memory[place : place + piece.nbytes].view(piece.dtype)
                into.reshape(piece.shape)[...] = piece
                place += piece.nbytes
        words = _words(struct, len(self._struct))
        words[:] = self._struct
        words.view(np.int64)[: len(self.sizes)] = list(self.sizes.values())
        words[self._block] = block
        for number, name in enumerate(self.rows, start=self._block + 1):
            if name in places:
                words[number] = first + places[name]
        return mujoco.MjModel._from_model_ptr(struct)


def copied(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy of a model of its own; of a large one in a fifth of the time that MuJoCo takes."""
    if not understood() or mujoco.mj_sizeModel(model) < _PAGE:
        return model.__copy__()
    return RawModel.of(model).model()


def changeable(model: mujoco.MjModel, *names: str) -> mujoco.MjModel:
    """A model with options and some arrays of its own; all others are those of another one, which
    has to live longer. Of a small one a copy of all.

    Geoms and meshes of a large one have no names there: the package makes tables of all names for
    every model, and for every state of it.
    """
    if not understood() or mujoco.mj_sizeModel(model) < _PAGE:
        return model.__copy__()
    file = RawModel.of(model)
    nowhere = file.sizes["nnames"] - 1  # the end of the last name
    for name in _NAMES_OF_MANY:
        file.rows[name] = [np.full(len(file.rows[name][0]), nowhere, np.int32)]
    return file.model(lent=fields()[1].keys() - {*names, *_NAMES_OF_MANY})


@cache
def understood() -> bool:
    """Whether models lie in memory as this module expects."""
    try:
        whole = mujoco.MjSpec.from_string(_SAMPLE).compile()
        again = RawModel.of(whole).model()
    except (ImportError, KeyError, AttributeError, TypeError, ValueError, OSError):
        return False
    same = (np.array_equal(rows_of(whole, one), rows_of(again, one)) for one in fields()[1])
    return all(same) and again.geom("b").id == 2


def _pointers(model: mujoco.MjModel, rows: dict[str, Rows]) -> int:
    """The word of a model's struct that points to its block; pointers to all arrays follow.

    Raises:
        ValueError: they do not.
    """
    known = {
        number: one.ctypes.data
        for number, (name, one) in enumerate(rows.items())
        if one.size and not isinstance(getattr(model, name), bytes)
    }
    sizes = len(fields()[0])
    words = _words(model._address, sizes + len(rows) + 1)
    where, address = next(iter(known.items()))
    for found in np.flatnonzero(words == address).tolist():
        begin = found - where
        words = _words(model._address, begin + len(rows))
        if begin > sizes and all(int(words[begin + number]) == at for number, at in known.items()):
            return int(begin - 1)
    raise ValueError("a model does not point to its arrays as expected")


def _words(address: int, count: int) -> NDArray[np.uint64]:
    return np.ctypeslib.as_array((ctypes.c_uint64 * count).from_address(address))


def _allocated(size: int) -> int:
    """Memory of MuJoCo's, which it gives back with the model."""
    address = _library().mju_malloc(size)
    if not address:
        raise MemoryError(f"no room for a model of {size >> 20} MiB")
    return int(address)


@cache
def _library() -> Any:
    folder = Path(mujoco.__file__).parent
    names = [*folder.glob("libmujoco*"), *folder.glob("mujoco.dll")]
    library = ctypes.CDLL(str(names[0]))
    library.mju_malloc.restype, library.mju_malloc.argtypes = c_void_p, (c_size_t,)
    return library


def _ask_for_large_pages(address: int, size: int) -> None:
    """Have the system take large pages where it can; nothing else changes by it."""
    if not sys.platform.startswith("linux") or size < 2 * _PAGE:
        return
    advise = ctypes.CDLL(None).madvise
    advise.restype, advise.argtypes = c_int, (c_void_p, c_size_t, c_int)
    begin, end = -(-address // _PAGE) * _PAGE, (address + size) // _PAGE * _PAGE
    advise(begin, end - begin, _LARGE_PAGES)
