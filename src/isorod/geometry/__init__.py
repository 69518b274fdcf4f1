"""The rod's map: a section's disk times a NURBS axis; needs only NumPy and SciPy."""
