"""Finite element solutions with NGSolve, on the very meshes of `comparisons.fem`."""
