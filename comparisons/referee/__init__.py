"""isorod as a solver of the package cosseratbench, whose experiments and measures of error are others' work."""
