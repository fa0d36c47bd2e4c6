"""Faults of sensors of contact, people and tags."""

from usarsim_conformance.planted.faults import plant

_TOUCH = "usarsim_server/sensors/contact.py"
_VICTIMS = "usarsim_server/sensors/people.py"
_RFID = "usarsim_server/sensors/rfid.py"
_SOUND = "usarsim_server/sensors/sound_gas.py"
_GAS = "usarsim_server/sensors/sound_gas.py"
_MOTION = "usarsim_server/sensors/people.py"

plant(
    "sensors.touch.reach-tenfold",
    _TOUCH,
    "PROBE_LENGTH = 0.003",
    "PROBE_LENGTH = 0.030",
    notices="control.values.touch-reach",
    field="Touch",
)
plant(
    "sensors.touch.never",
    _TOUCH,
    "self.touched = bool(np.isfinite(hits[0].distances).any())",
    "self.touched = False",
    notices="control.values.touch-reach",
    field="Touch",
)
plant(
    "sensors.touch.always",
    _TOUCH,
    "self.touched = bool(np.isfinite(hits[0].distances).any())",
    "self.touched = True",
    notices="control.values.touch-reach",
    field="Touch",
)
plant(
    "sensors.touch.diameter-conf",
    _TOUCH,
    '(("Diameter", fixed(self.diameter, 4)),)',
    '(("Diameter", fixed(4.0 * self.diameter, 4)),)',
    notices="control.values.touch-diameter",
    field="Diameter",
)
plant(
    "sensors.touch.pad-size",
    _TOUCH,
    "starts = disc_probes(self.diameter / 2)",
    "starts = disc_probes(2.0 * self.diameter)",
    notices="control.values.touch-diameter",
    field="Diameter",
)
plant(
    "sensors.bumper.reach",
    "usarsim_server/sensors/contact.py",
    "probe_length = 0.02",
    "probe_length = 0.002",
    notices="control.values.bumper-reach",
    field="Touch of Bumper",
)
for _axis, _signs in (("x", "-1, 1, 1"), ("y", "1, -1, 1"), ("z", "1, 1, -1")):
    plant(
        f"sensors.victims.{_axis}-sign",
        _VICTIMS,
        "np.array(place) + distance",
        f"np.array(place) * np.array([{_signs}]) + distance",
        notices="control.values.victim-location",
        field=f"{_axis} of Location",
        robot="RescueP2AT",
    )
plant(
    "sensors.victims.location-scale",
    _VICTIMS,
    "np.array(place) + distance",
    "0.8 * np.array(place) + distance",
    notices="control.values.victim-location",
    field="of Location",
    robot="RescueP2AT",
)
for _name, _factor in (("none", "0.0"), ("double", "2.0")):
    plant(
        f"sensors.victims.noise-{_name}",
        _VICTIMS,
        "distance * self.noise * self._rng.standard_normal(3)",
        f"{_factor} * distance * self.noise * self._rng.standard_normal(3)",
        notices="control.values.victim-noise",
        field="noise of Location",
        robot="RescueP2AT",
    )
plant(
    "sensors.victims.fov-double",
    _VICTIMS,
    "yaws = _angles(self.horizontal_fov, self.step, yaw_shift)",
    "yaws = _angles(3.0 * self.horizontal_fov, self.step, yaw_shift)",
    notices="control.values.victim-view",
    field="HorizontalFOV",
    robot="RescueP2AT",
)
plant(
    "sensors.victims.fov-tall",
    _VICTIMS,
    "pitches = _angles(self.vertical_fov, self.step, pitch_shift)",
    "pitches = _angles(3.0 * self.vertical_fov, self.step, pitch_shift)",
    notices="control.values.victim-view",
    field="VerticalFOV",
    robot="RescueP2AT",
)
plant(
    "sensors.victims.fov-narrow",
    _VICTIMS,
    "yaws = _angles(self.horizontal_fov, self.step, yaw_shift)",
    "yaws = _angles(0.1 * self.horizontal_fov, self.step, yaw_shift)",
    notices="control.values.victim-view",
    field="HorizontalFOV",
    robot="RescueP2AT",
)
plant(
    "sensors.victims.range-double",
    _VICTIMS,
    "fan_at(pose, self._grids[self._turn], self.max_range, identify=True)",
    "fan_at(pose, self._grids[self._turn], 2.0 * self.max_range, identify=True)",
    notices="control.values.victim-view",
    field="MaxRange",
    robot="RescueP2AT",
)
plant(
    "sensors.victims.range-short",
    _VICTIMS,
    "fan_at(pose, self._grids[self._turn], self.max_range, identify=True)",
    "fan_at(pose, self._grids[self._turn], 0.4 * self.max_range, identify=True)",
    notices="control.values.victim-view",
    field="MaxRange",
    robot="RescueP2AT",
)
plant(
    "sensors.victims.conf-fov-degrees",
    _VICTIMS,
    '("HorizontalFOV", fixed(self.horizontal_fov, 4))',
    '("HorizontalFOV", fixed(57.29578 * self.horizontal_fov, 4))',
    notices="control.values.victim-view",
    field="HorizontalFOV",
    robot="RescueP2AT",
)
for _axis, _new in (("x", "(-x, y, z)"), ("y", "(x, -y, z)"), ("z", "(x, y, -z)")):
    plant(
        f"sensors.rfid.{_axis}-sign",
        _RFID,
        "self._heard = [(tag, vector(relative(pose, tag.position), 2)) for tag in heard]",
        "self._heard = [\n"
        f"            (tag, vector({_new}, 2))\n"
        "            for tag in heard\n"
        "            for x, y, z in [relative(pose, tag.position)]\n"
        "        ]",
        notices=("control.values.rfid-location", "control.values.rfid-tag-location"),
        field=f"{_axis} of Location",
        robot="KitBench",
    )
plant(
    "sensors.rfid.world-place",
    _RFID,
    "vector(relative(pose, tag.position), 2)",
    "vector(tag.position, 2)",
    notices="control.values.rfid-location",
    field="of Location",
    robot="RescueP2AT",
)
plant(
    "sensors.rfid.drop-place",
    _RFID,
    "self._life.drop(self.world_pose(robot).position)",
    "self._life.drop(robot.pose.position)",
    notices="control.values.rfid-location",
    field="of Location",
    robot="RescueP2AT",
)
plant(
    "sensors.victim-tag.mirrored",
    _RFID,
    "self._found = victim, vector(relative(pose, place), 2)",
    "x, y, z = relative(pose, place)\n        self._found = victim, vector((x, -y, z), 2)",
    notices="control.values.victim-tag",
    field="y of Location",
    robot="RescueP2AT",
)
plant(
    "sensors.co2.linear",
    _GAS,
    "co2 / max(math.dist(head, here), NEAREST) ** 2",
    "co2 / max(math.dist(head, here), NEAREST)",
    notices="control.values.co2",
    field="Density",
    robot="RescueP2AT",
)
plant(
    "sensors.sound.fading",
    _SOUND,
    "- 20.0 * math.log10(max(felt, 1.0))",
    "- 10.0 * math.log10(max(felt, 1.0))",
    notices="control.values.loudness",
    field="Loudness",
    robot="RescueP2AT",
)
plant(
    "sensors.sound.grows",
    _SOUND,
    "- 20.0 * math.log10(max(felt, 1.0))",
    "+ 20.0 * math.log10(max(felt, 1.0))",
    notices="control.values.loudness",
    field="Loudness",
    robot="RescueP2AT",
)
plant(
    "sensors.acoustic.direction-mirrored",
    _SOUND,
    "vector((x / length, y / length, -z / length), 2)",
    "vector((x / length, -y / length, -z / length), 2)",
    notices="control.values.acoustic",
    field="y of Direction",
    robot="KitBench",
)
plant(
    "sensors.acoustic.direction-down",
    _SOUND,
    "vector((x / length, y / length, -z / length), 2)",
    "vector((x / length, y / length, z / length), 2)",
    notices="control.values.acoustic",
    field="z of Direction",
    robot="KitBench",
)
plant(
    "sensors.acoustic.duration",
    _SOUND,
    '("Duration", fixed(sound.noise.duration, 4))',
    '("Duration", fixed(1000.0 * sound.noise.duration, 4))',
    notices="control.values.acoustic",
    field="Duration",
    robot="KitBench",
)
plant(
    "sensors.acoustic.delay",
    _SOUND,
    "delay = max(0.0, distance / SPEED_OF_SOUND + sound.start - robot.time)",
    "delay = distance + robot.time - sound.start",
    notices="control.values.acoustic",
    field="Delay",
    robot="KitBench",
)
plant(
    "sensors.human-motion.grows",
    _MOTION,
    "(1.0 - distance / self.max_range) * min",
    "(distance / self.max_range) * min",
    notices="control.values.human-motion",
    field="Prob",
    robot="RescueP2AT",
)
plant(
    "sensors.human-motion.scale",
    _MOTION,
    "(1.0 - distance / self.max_range) * min",
    "0.5 * (1.0 - distance / self.max_range) * min",
    notices="control.values.human-motion",
    field="Prob",
    robot="RescueP2AT",
)
plant(
    "sensors.human-motion.standing",
    _MOTION,
    "if one.speed > 0.0 and within_cone",
    "if within_cone",
    also=[
        (_MOTION, "min(1.0, speed / self.full_speed)", "1.0"),
        (
            _MOTION,
            "[victim for victim in self._life.victims if victim.moves]",
            "list(self._life.victims)",
        ),
    ],
    notices="control.values.human-motion",
    field="Prob",
    robot="RescueP2AT",
)
