"""Finite element meshes of the same geometry: every node is put by the Rod's own map.

``python -m meshes spring`` writes a .msh file; `meshes.spring` and its like return a `Mesh` to whoever solves on it.
"""
