"""Plant faults in copies of the server, and print which checks notice them.

`python tests/conformance/try_planted.py 'sensors.gps*'` tries those whose name fits, without a
pattern all of them. The exit status is 1 if a fault was not noticed. `planted/__init__.py` says
what a fault is.
"""

from __future__ import annotations

import argparse
import sys
from operator import attrgetter

from planted import all_faults
from planted.trial import Outcome, as_table, try_faults

from usarsim_conformance.registry import select
from usarsim_conformance.reports import ProgressPrinter


def main() -> int:
    """Try the faults that the command line names; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pattern", nargs="?", default="*", help="faults whose name fits")
    parser.add_argument("--list", action="store_true", help="list them and do nothing else")
    given = parser.parse_args()
    faults = select(all_faults(), given.pattern, attrgetter("name"))
    if not faults:
        parser.error(f"no fault fits {given.pattern!r} (--list tells all names)")
    if given.list:
        width = max(len(fault.name) for fault in faults)
        for fault in faults:
            print(f"{fault.name:{width}}  {fault.robot}  {', '.join(fault.notices)}")
        print(f"{len(faults)} faults")
        return 0
    teller = ProgressPrinter(sys.stderr)

    def tell(outcome: Outcome) -> None:
        teller.say(f"{'' if outcome.good else 'WRONG  '}{outcome.name}")

    outcomes = try_faults(faults, tell=tell)
    print(as_table(outcomes))
    return 0 if all(outcome.good for outcome in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
