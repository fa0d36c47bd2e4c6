"""A study file that is right, for tests to change."""

STUDY = """\
title = "Keyboard or gamepad"
seed = 7
participants = 8
primary = "victims_credited"
secondary = ["tlx_raw", "collisions"]

[[condition]]
name = "keyboard"
label = "Keyboard"
device = "keyboard"

[[condition]]
name = "gamepad"
label = "Gamepad"
device = "gamepad"

[[layout]]
name = "A"
mission = "office-a.toml"
path_length = 60.0
occlusion = 0.4

[[layout]]
name = "B"
mission = "office-b.toml"
path_length = 62.0
occlusion = 0.41

[training]
mission = "slalom.toml"

[[form]]
name = "before"
kind = "questionnaire"
when = "before"
title = "Before we begin"

[[form.item]]
name = "games"
text = "How often do you play?"

[[form.item]]
name = "hand"
text = "Which hand do you write with?"
kind = "choice"

[[form.item.choice]]
name = "left"
text = "Left"

[[form.item.choice]]
name = "right"
text = "Right"

[[form]]
name = "workload"
kind = "nasa-tlx"
when = "after_trial"

[[form]]
name = "which"
kind = "preference"
when = "after"

[[probe]]
at = 300
question = "where_is"
robot = 3
"""
