"""`python -m usarsim_server.cli` is the same as `usarsim`."""

from __future__ import annotations

import sys

from usarsim_server.__main__ import main

if __name__ == "__main__":
    sys.exit(main())
