"""The checks, one file per subject; a new file is enough to add one (see `doctor/registry.py`)."""
