"""Static equilibrium by SNES."""

from isorod.statics.analysis import Equilibrium, solve

__all__ = ["Equilibrium", "solve"]
