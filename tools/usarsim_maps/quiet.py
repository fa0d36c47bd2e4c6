"""What libraries have to say while a map is read goes into the log, not to the terminal."""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Iterator

import mujoco

from usarsim_server.logs import ROOT, Log

_log = Log("import")


def _told(text: str) -> None:
    _log.debug(" ".join(text.split()), source="mujoco")


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Log at `debug` what Python warns of, what loggers without handler say, and what MuJoCo does.

    What it means for the map is in the report: what was left out, and what is missing. Filters of
    warnings stay as they are, so those that are errors in tests still are.
    """
    handler = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_told)
    last = logging.lastResort
    logging.lastResort = _Passing(last)
    try:
        with warnings.catch_warnings(record=True) as caught:
            yield
        for one in caught:
            text = f"{one.category.__name__}: {one.message}"
            _log.debug(" ".join(text.split()), source=one.filename)
    finally:
        logging.lastResort = last
        mujoco.set_mju_user_warning(handler)


class _Passing(logging.Handler):
    """The handler of last resort for the program's own lines only."""

    def __init__(self, last: logging.Handler | None) -> None:
        super().__init__(logging.WARNING)
        self._last = last

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a line of the program's own on."""
        if self._last is not None and record.name.partition(".")[0] == ROOT:
            self._last.handle(record)
