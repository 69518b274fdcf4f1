"""The finite element configurations that studies run."""
