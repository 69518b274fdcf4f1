"""Any rods of isorod's by finite elements: the same model, on a mesh of its rods, in dolfinx."""

from comparisons.fem.rods.solving import solve

__all__ = ["solve"]
