"""What an author of a propagation model needs; see docs/wireless.md."""

from usarsim_server.fields import field
from usarsim_server.radio.models import NOTHING, LogDistance, Obstacle, Propagation, register
from usarsim_server.tables import Table

__all__ = ["NOTHING", "LogDistance", "Obstacle", "Propagation", "Table", "field", "register"]
