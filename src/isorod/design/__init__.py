"""Derivatives of results with respect to parameters of scenes; design optimisation and parameter identification."""
