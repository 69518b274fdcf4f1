"""Derivatives of what scenes measure by their parameters, and what these are for: design, and identification."""
