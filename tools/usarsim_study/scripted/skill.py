"""How a scripted operator is: quick or slow, attentive or not, better with one device or another.

A participant's skill is drawn from the seed of the study and the participant's number alone, so a
study of scripted operators can be made again. An advantage of a device is planted here and nowhere
else, in speed and what follows from it: with `advantage` 0 both devices drive alike, and a study
can only find chance.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, replace
from typing import Literal

from usarsim_study.study_file import Study

Device = Literal["keyboard", "gamepad"]
ADVANTAGE = 1.1
"""Of the gamepad, planted: so much faster than the mean of both, as a part of it."""
SPEED = 0.5
"""Part of the highest wheel speed at which people drive, on average over devices."""
CAREFUL = 0.3
"""The most of it in a training."""
_LEAST, _MOST = 0.1, 0.8


@dataclass(frozen=True, slots=True)
class Skill:
    """One operator.

    Attributes:
        reaction: s from a sight to the mark, and from the choice of a robot to its first command.
        dwell: s for which one robot is looked at, on average.
        neglect: share of turns in which a robot is passed over.
        miss: share of sights in which a victim is not recognised.
        error: of a mark, standard deviation along each axis, m.
        range: at which somebody is recognised, m.
        half_angle: off the middle of the picture, rad.
        keyboard, gamepad: part of the highest wheel speed, by device.
        turn: the same for turning; one for all devices.
    """

    reaction: float = 1.2
    dwell: float = 15.0
    neglect: float = 0.1
    miss: float = 0.1
    error: float = 0.25
    range: float = 5.0
    half_angle: float = 0.5
    keyboard: float = SPEED
    gamepad: float = SPEED
    turn: float = 0.2

    def speed(self, device: Device) -> float:
        """Part of the highest wheel speed at which it drives."""
        return self.keyboard if device == "keyboard" else self.gamepad

    def holding(self, device: Device) -> Skill:
        """The same person with a device in hand: whose hands are busy looks less.

        By what a device lacks, as a part of the better one's speed, the reaction gets longer; half
        that part of what was recognised is missed.
        """
        lack = 1.0 - self.speed(device) / max(self.keyboard, self.gamepad)
        return replace(
            self,
            reaction=self.reaction * (1.0 + lack),
            miss=1.0 - (1.0 - self.miss) * (1.0 - lack / 2.0),
        )


def drawn(seed: int, number: int, advantage: float = ADVANTAGE) -> Skill:
    """The skill of a participant.

    Args:
        seed: of the study.
        number: of the participant.
        advantage: of the gamepad; its speed is (1 + advantage / 2) times the person's mean, that of
            the keyboard (1 - advantage / 2).
    """
    chance = random.Random(f"scripted/{seed}/{number}")
    ability = min(max(chance.gauss(1.0, 0.1), 0.7), 1.3)
    mean = SPEED * ability
    return Skill(
        reaction=round(1.2 / ability * chance.uniform(0.9, 1.1), 3),
        dwell=round(chance.uniform(10.0, 18.0), 3),
        neglect=round(chance.uniform(0.0, 0.15), 3),
        miss=round(min(max(chance.gauss(0.1, 0.05), 0.0), 0.4), 3),
        error=round(chance.uniform(0.15, 0.35), 3),
        keyboard=_stepped(mean * (1.0 - advantage / 2.0), chance),
        gamepad=_stepped(mean * (1.0 + advantage / 2.0), chance),
    )


def planted(study: Study, advantage: float) -> float:
    """The advantage of the gamepad in a study: none where nobody drives with one."""
    return advantage if any(one.device == "gamepad" for one in study.condition) else 0.0


def careful(skill: Skill, device: Device) -> Skill:
    """The same person in a training."""
    slow = min(CAREFUL, skill.speed(device))
    return replace(skill, keyboard=slow, gamepad=slow, miss=0.0, error=0.1)


def _stepped(speed: float, chance: random.Random) -> float:
    """Keys set speeds in steps of 0.1; between two of them chance decides."""
    lower = int(10.0 * speed) / 10.0
    found = lower + 0.1 * (chance.random() < 10.0 * (speed - lower))
    return round(min(max(found, _LEAST), _MOST), 1)
