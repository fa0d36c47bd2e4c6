"""Our own server keeps the rules of its side channels, asked by the kit over real sockets."""

from __future__ import annotations

import asyncio

from usarsim_conformance.registry import all_checks, select
from usarsim_conformance.runner import judge_all
from usarsim_conformance.side_lines import split_reply
from usarsim_conformance.survey import Target
from usarsim_conformance.verdicts import Verdict
from usarsim_server.protocol.images import RAW
from usarsim_server.testing import running_server

QUICK = (
    "images.rectangle.*,images.raw.*,images.header.*,groundtruth.getobs.[deku]*,"
    "groundtruth.getpos.[fst]*,wireless.init.*,wireless.relay.[bt]*,comserver.*,truth.query.*"
)
"""Rules that are judged without long silences; `usarsim conformance --self` judges all."""
SIDES = ("images", "groundtruth", "wireless", "comserver", "truth")


def test_our_server_keeps_the_rules() -> None:
    """No rule is broken, none is left open, and with raw pictures none of these is skipped."""
    names = ("image", "groundtruth", "wireless", "comserver", "truth")
    ports = dict.fromkeys((f"{name}_port" for name in names), 0)
    checks = select(all_checks(), QUICK)
    assert len(checks) > 40
    with running_server(world="empty", image_type=RAW, max_robots=16, **ports) as (_, found):
        target = Target(ports={name: found[name].port for name in ("control", *SIDES)})
        report = asyncio.run(judge_all(target, checks))
    wrong = [one for one in report.results if one.verdict is not Verdict.PASS]
    assert not wrong, [(one.check, one.verdict, one.reason) for one in wrong]


def test_every_side_channel_has_many_rules() -> None:
    """More than a hundred rules, each with its source in the reference, and a docstring."""
    checks = [check for check in all_checks() if check.service in SIDES]
    assert len(checks) >= 120
    for check in checks:
        assert check.source.startswith("side channels reference "), check.id
        assert len(check.rule) > 20, check.id
    assert {check.service for check in checks} == set(SIDES)


def test_the_splitter_stops_at_the_first_surprise() -> None:
    """Two blanks between groups, or none, lose all that follows (side channels reference 3.4)."""
    robot = "{Name A Location 1,2,3 BatteryEmpty False}"
    for between, robots in ((" ", 2), ("  ", 0), ("", 0)):
        kind, groups = split_reply(f"POSITIONS {{Robots 2}}{between}{robot}{between}{robot}")
        assert kind == "POSITIONS"
        assert len(groups) == 1 + robots
    assert split_reply("POSITIONS  {Robots 0}") == ("POSITIONS", [])
