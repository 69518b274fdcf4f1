"""Explicit steps, compiled."""
