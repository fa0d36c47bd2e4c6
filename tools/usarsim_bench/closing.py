"""What ends a measurement must not hide what went wrong in it."""

from __future__ import annotations

from types import TracebackType

from usarsim_bench.errors import BenchError
from usarsim_client.closing import Closing


class CarefulClosing(Closing):
    """Something whose closing may find a fault of its own."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self.close()
        except BenchError:
            # What went wrong first says more.
            if error is None:
                raise
