"""Vibration modes by SLEPc."""

from isorod.modal.analysis import solve
from isorod.modal.modes import Modes

__all__ = ["Modes", "solve"]
