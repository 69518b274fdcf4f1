"""Finite element meshes of the same geometry: every node is put by the Rod's own map.

``python -m meshes my.toml`` writes a .msh file; `meshes.rods.build` returns a `Mesh` of any rods to whoever solves on
it, `meshes.spring` and its like those of the published scenes.
"""
