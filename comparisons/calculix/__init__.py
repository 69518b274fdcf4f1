"""Finite element solutions with CalculiX, a program of its own, on the nodes of the meshes of `comparisons.fem`."""
