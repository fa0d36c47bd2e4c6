"""Who hears whom: models of radio, links of a team, and what a robot expects of its own radio.

One file per family of models in `families`; a new file is enough, and outside packages use the
entry point group `usarsim.radios`. Distances and ranges are cells; a chain of links counts as a
link (exploration reference 10).
"""

from usarsim_exploration.radio.estimate import RadioEstimate, outline
from usarsim_exploration.radio.families.path_loss import PathLoss
from usarsim_exploration.radio.families.ranges import Circle, Sight
from usarsim_exploration.radio.families.recorded import Recorded
from usarsim_exploration.radio.families.subt import SubT
from usarsim_exploration.radio.links import Links, find_links
from usarsim_exploration.radio.models import Radio, create_radio, radio_names, register

__all__ = [
    "Circle", "Links", "PathLoss", "Radio", "RadioEstimate", "Recorded", "Sight", "SubT",
    "create_radio", "find_links", "outline", "radio_names", "register",
]  # fmt: skip
