"""Random vibration: from the spectral density of an excitation to root mean squares."""

from isorod.random.analysis import solve
from isorod.random.response import RandomResponse

__all__ = ["RandomResponse", "solve"]
