"""Vibration modes by SLEPc."""

from isorod.modal.analysis import Modes, solve

__all__ = ["Modes", "solve"]
