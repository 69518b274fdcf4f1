"""Results: records, checkpoints, stresses and VTK files."""
