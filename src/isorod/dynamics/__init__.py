"""Motion in time: explicit and implicit steps."""

from isorod.dynamics.analysis import solve
from isorod.dynamics.history import History

__all__ = ["History", "solve"]
