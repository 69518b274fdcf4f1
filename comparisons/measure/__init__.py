"""What a study measures: runs timed in fresh processes, converged values, records."""
