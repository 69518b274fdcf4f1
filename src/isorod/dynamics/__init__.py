"""Motion in time: explicit and implicit steps."""

from isorod.dynamics.analysis import History, solve

__all__ = ["History", "solve"]
