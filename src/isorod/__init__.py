"""Rods as full 3-D continua, solved through surface control points alone."""

__version__ = "0.1.0"
