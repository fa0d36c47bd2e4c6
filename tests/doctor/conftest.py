"""Settings of this room's tests."""

from __future__ import annotations

from hypothesis import settings

# The same examples in every run, and no complaints about a busy machine.
settings.register_profile("deterministic", derandomize=True, deadline=None)
settings.load_profile("deterministic")
