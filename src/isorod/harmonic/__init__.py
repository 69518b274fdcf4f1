"""Harmonic response by modes and residual vectors."""

from isorod.harmonic.analysis import solve
from isorod.harmonic.damping import Damping
from isorod.harmonic.frequencies import Span
from isorod.harmonic.response import Response

__all__ = ["Damping", "Response", "Span", "solve"]
