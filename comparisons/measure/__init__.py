"""Measurements of studies: runs timed in fresh processes, converged values, records."""
