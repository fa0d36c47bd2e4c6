"""What an author of a propagation model needs; see docs/wireless.md."""

from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table
from usarsim_server.radio.models import NOTHING, LogDistance, Obstacle, Propagation, register

__all__ = ["NOTHING", "LogDistance", "Obstacle", "Propagation", "Table", "field", "register"]
