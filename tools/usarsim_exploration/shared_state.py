"""What all robots of a process share behind a strategy: variables of its modules and classes."""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Iterable, Iterator, Mapping
from types import FunctionType, MethodType, ModuleType

import numpy as np

LIBRARIES = frozenset(sys.stdlib_module_names | {"cv2", "llvmlite", "numba", "numpy", "scipy"})
"""Modules that are no strategy's."""
_OURS = frozenset({"usarsim_exploration", "usarsim_server"})
_PLAIN = (bool, int, float, complex, str, bytes, type(None))
Values = dict[tuple[str, str], object]


class Shared:
    """Variables of the modules of a strategy, and what classes and functions in there carry along.

    Its modules are the one that it is in, those in the same folder, and those of its package; not
    libraries, and not this program.
    """

    def __init__(self, strategy: type) -> None:
        """Of the class of a strategy."""
        self._strategy = strategy
        self._own = strategy.__module__
        self._package = self._own.partition(".")[0]
        self._folder = _folder(sys.modules.get(self._own))
        self._known: dict[str, bool] = {}

    def values(self) -> Values:
        """What is in each variable now, in a form that can be compared, by module and name."""
        found: Values = {}
        for name, module in list(sys.modules.items()):
            if self._mine(name):
                found |= {
                    (name, key): self._content(value, {})
                    for key, value in list(vars(module).items())
                    if not key.startswith("__") and not isinstance(value, ModuleType)
                }
        for one in self._strategy.__mro__:  # a class in a function is no variable of a module
            if self._mine(one.__module__):
                found[one.__module__, one.__qualname__] = self._content(one, {})
        return found

    def _mine(self, name: str) -> bool:
        """Whether the module of that name is one of the strategy's; thousands are asked about."""
        known = self._known.get(name)
        if known is None:
            known = self._is_mine(name)
            if name in sys.modules:
                self._known[name] = known
        return known

    def _is_mine(self, name: str) -> bool:
        top = name.partition(".")[0]
        if name == self._own or top in LIBRARIES:
            return name == self._own
        if top == self._package and top not in _OURS:
            return True
        return self._folder != "" and _folder(sys.modules.get(name)) == self._folder

    def _content(self, value: object, met: dict[int, int]) -> object:
        """A value and what hangs on it. met: numbers of those that were met before, by id."""
        if isinstance(value, _PLAIN):
            return repr(value)
        if id(value) in met:
            return "met", met[id(value)]
        met[id(value)] = len(met)
        if isinstance(value, np.ndarray) and value.dtype != object:
            return value.shape, value.dtype.str, value.tobytes()
        if isinstance(value, Mapping):
            parts: Iterable[object] = [part for pair in value.items() for part in pair]
        elif isinstance(value, list | tuple):
            parts = value
        elif isinstance(value, set | frozenset):
            parts = sorted(value, key=repr)
        elif isinstance(value, type | FunctionType | MethodType):
            parts = self._hanging(value)
        elif hasattr(value, "__dict__") and self._mine(type(value).__module__):
            parts = [vars(value)]
        else:
            return _state(value)
        return type(value).__name__, [self._content(part, met) for part in parts]

    def _hanging(self, value: type | FunctionType | MethodType) -> Iterator[object]:
        """What a class or a function of a strategy carries along; nothing of others."""
        if isinstance(value, MethodType):
            yield from (value.__self__, value.__func__)
        elif isinstance(value, type):
            if self._mine(value.__module__):
                for name, one in list(vars(value).items()):
                    if not name.startswith(("__", "_abc_")):
                        yield from (name, one)
        elif self._mine(value.__module__ or ""):
            yield from (value.__defaults__, value.__kwdefaults__, vars(value))
            for cell in value.__closure__ or ():
                try:
                    yield cell.cell_contents
                except ValueError:  # nothing is in it yet
                    yield None


def changes(before: Values, after: Values) -> list[str]:
    """Variables with another content, or that are new in a module that was there."""
    modules = {module for module, _ in before}
    return [
        f"{module}.{name}"
        for (module, name), value in after.items()
        if module in modules and value != before.get((module, name))
    ]


def _folder(module: ModuleType | None) -> str:
    """Where the file of a module lies; empty: it has none."""
    return os.path.dirname(getattr(module, "__file__", None) or "")


def _state(value: object) -> object:
    """Of something of a library: its bytes, or, where it has none, which it is."""
    try:
        return pickle.dumps(value)
    except Exception:  # whatever libraries raise
        return id(value)
