"""What the conditions of a study let operators do: the device that drives, whose robot it is."""

from __future__ import annotations

import pytest
from virtual_station import VirtualPage, VirtualStation

from usarsim_operator.allowance import Allowance, halves
from usarsim_operator.roles import Role, Tokens

_STILL = {"left": 0.0, "right": 0.0}
_AHEAD = {"left": 0.5, "right": 0.5}


async def test_only_the_device_of_the_condition_drives() -> None:
    """What another device wants is refused with a reason; zero, an instructor, stops are not."""
    station = VirtualStation(allowance=Allowance("gamepad"))
    station.spawned("R1")
    ada = VirtualPage(station, "Ada", Role.OPERATOR)
    assert (await ada.ask("take", robot="R1"))["ok"]
    for device in ({"device": "keyboard"}, {"device": "touch"}, {"device": "program"}, {}):
        answer = await ada.ask("drive", robot="R1", **_AHEAD, **device)
        assert not answer["ok"]
        assert answer["why"] == "only the gamepad drives here"
    wishes = {"fly": ("altitude", "linear", "lateral", "rotational"), "steer": ("speed", "steer")}
    for kind, keys in wishes.items():
        wish = dict.fromkeys(keys, 0.2)
        answer = await ada.ask(kind, robot="R1", device="keyboard", **wish)
        assert answer["why"] == "only the gamepad drives here"
    assert not any(b"0.5" in data for _, _, data in station.wire)
    assert (await ada.ask("drive", robot="R1", device="pad", **_AHEAD))["ok"]
    assert (await ada.ask("drive", robot="R1", device="keyboard", **_STILL))["ok"]
    ina = VirtualPage(station, "Ina", Role.INSTRUCTOR)
    assert (await ina.ask("take", robot="R1", force=True))["ok"]
    assert (await ina.ask("drive", robot="R1", device="keyboard", **_AHEAD))["ok"]
    await station.end(ada, ina)


async def test_robots_of_two_operators() -> None:
    """HRI-19: each drives the half that is theirs, and is told whose the others are."""
    names = ["R1", "R2", "R3"]
    split = halves(names, 2)
    assert split == {"R1": 1, "R2": 1, "R3": 2}
    station = VirtualStation(allowance=Allowance(split=split, fixed=True))
    for name in [*names, "R9"]:
        station.spawned(name)
    ada = VirtualPage(station, "Ada", Role.OPERATOR, 1)
    ben = VirtualPage(station, "Ben", Role.OPERATOR, 2)
    refused = "R3 is for operator 2 to drive"
    for kind, more in (
        ("take", {}),
        ("enable", {"on": False}),
        ("policy", {"policy": "hold"}),
        ("drive", _AHEAD),
        ("light", {"on": True}),
    ):
        answer = await ada.ask(kind, robot="R3", **more)
        assert (answer["ok"], answer["why"]) == (False, refused), kind
    assert (await ben.ask("take", robot="R3"))["ok"]
    assert (await ben.ask("drive", robot="R3", **_AHEAD))["ok"]
    assert not (await ben.ask("take", robot="R1"))["ok"]
    for page in (ada, ben):  # nobody's robot is everybody's
        assert (await page.ask("take", robot="R9"))["ok"]
        assert (await page.ask("hand_back", robot="R9"))["ok"]
    for kind, more in (("remove", {"robot": "R1"}), ("spawn", {"class": "P3AT"})):
        answer = await ada.ask(kind, **more)
        assert answer["why"] == "the robots of this trial are fixed"
    assert (await ada.ask("mark", robot="R3", place=[1.0, 2.0, 0.0]))["ok"]
    station.pulse.beat()
    await station.settle()
    state = next(one for one in reversed(ada.texts) if one["type"] == "state")
    assert [row["seat"] for row in state["robots"]] == [1, 1, 2, None]
    assert [facts["seat"] for what, facts in station.notes if what == "page comes"] == [1, 2]
    await station.end(ada, ben)


def test_each_seat_has_a_token() -> None:
    tokens = Tokens(seats=2)
    told = dict(tokens.all())
    assert list(told) == ["operator 1", "operator 2", "instructor", "viewer"]
    assert len(set(told.values())) == 4
    seats = [tokens.seat(secret) for secret in told.values()]
    assert seats == [
        (Role.OPERATOR, 1),
        (Role.OPERATOR, 2),
        (Role.INSTRUCTOR, 0),
        (Role.VIEWER, 0),
    ]
    assert [who for who, _ in Tokens().all()] == ["operator", "instructor", "viewer"]
    assert tokens.seat("x") is None


@pytest.mark.parametrize(
    ("told", "why"),
    [({"device": "mouse"}, "no device mouse"), ({"split": {"R1": 0}}, "from 1 on")],
)
def test_what_cannot_be_allowed(told: dict[str, object], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        Allowance(**told)  # type: ignore[arg-type]
