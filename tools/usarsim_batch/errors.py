"""What a user of batches can do wrong; see `usarsim_server.errors`."""

from __future__ import annotations

from usarsim_server.errors import UsarsimError


class BatchError(UsarsimError):
    """A batch, its folder, or who should play it cannot be used."""
