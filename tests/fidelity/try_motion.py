"""Run the physics acceptance tests and print their table: `make fidelity`."""

import sys

from motion.fidelity import main

if __name__ == "__main__":
    sys.exit(main())
