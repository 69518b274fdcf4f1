"""The finite element side, in dolfinx: the same geometry, material and supports as isorod's scenes."""
