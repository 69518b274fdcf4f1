"""Implicit steps that keep energy and momentum."""
