"""The rules of a run, by number: results carry theirs, so that old ones still come out the same.

What strategies, levels and end rules do otherwise than before stands here as one flag each, and
code asks the flag, never the number. Rules 1 are those of results without a number.
"""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True)
class RunRules:
    """What holds in a run.

    Attributes:
        number: in results.
        sight: beams end between two walls that touch at a corner, walls that beams pass through
            are free from then on, and a wall that one beam with noise has met is not certain.
        narrow: frontiers of one and two cells count where nothing larger is left.
        starts: robots start where the base can be reached from; where they have bodies, as many
            metres apart at any width of a cell, and so do they keep away, arrive, gather and
            choose; where they arrive, they look at what is unknown.
        ends: a team is not home while data is still to be sent.
        ties: robots in one cell share out what all of them would choose.
        shares: what is known and reachable now, of what is reachable now; else what was known, of
            what was reachable at the start.
        short: frontiers are parted by what a scanner shows of them from one cell, and who sees
            less on its way than it drives in a step drives on into the unknown.
        relays: `relay_explores` counts; else relays explore whatever it says.
        mresim: MRESim's: first steps are random, robots in contact plan at every step, by frontiers
            of its kind, and know how many free cells there are.
    """

    number: int
    sight: bool = True
    narrow: bool = True
    starts: bool = True
    ends: bool = True
    ties: bool = True
    shares: bool = True
    short: bool = True
    relays: bool = True
    mresim: bool = False

    def by_mresim(self) -> RunRules:
        """The same, but as MRESim's where that has rules of its own."""
        return replace(
            self,
            sight=False,
            narrow=False,
            starts=False,
            ends=False,
            ties=False,
            short=False,
            mresim=True,
        )


RULES = {
    1: RunRules(
        1,
        sight=False,
        narrow=False,
        starts=False,
        ends=False,
        ties=False,
        shares=False,
        short=False,
        relays=False,
    ),
    2: RunRules(2),
}
"""By number."""
OLDEST, NEWEST = min(RULES), max(RULES)
TODAY = RULES[NEWEST]
