"""The checks, one file per subject; a new file is enough to add one (see `registry.py`)."""
