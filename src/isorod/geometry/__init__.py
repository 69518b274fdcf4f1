"""The rod's map: a section's disk times a NURBS axis; NumPy and SciPy alone."""
