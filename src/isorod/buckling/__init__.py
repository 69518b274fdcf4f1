"""Buckling: load factors at which the equilibrium is no longer the only one, and the shapes that it takes."""

from isorod.buckling.analysis import solve
from isorod.buckling.modes import BucklingModes

__all__ = ["BucklingModes", "solve"]
