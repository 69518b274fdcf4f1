"""Finite element bodies of dolfinx; nothing else in isorod imports it, nor loads it where a scene has none."""
