"""What a user of batches can do wrong; see `usarsim_server.base.errors`."""

from __future__ import annotations

from usarsim_server.base.errors import UsarsimError


class BatchError(UsarsimError):
    """A batch, its folder, or who should play it cannot be used."""
