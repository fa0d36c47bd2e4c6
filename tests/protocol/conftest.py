"""Settings of the protocol tests."""

from __future__ import annotations

from hypothesis import settings

# No deadline per example: a busy machine is no defect. Tests that bound time measure it themselves.
settings.register_profile("protocol", deadline=None)
settings.load_profile("protocol")
