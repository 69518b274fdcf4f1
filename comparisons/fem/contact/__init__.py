"""Frictionless contact between surfaces of meshes; nothing here knows dolfinx."""
