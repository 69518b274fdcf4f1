"""How displacements, and pressures, are approximated on a rod."""

from isorod.space.space import Space

__all__ = ["Space"]
