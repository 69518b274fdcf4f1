"""Material laws, one a file."""

from isorod.material.law import LinearElastic, Material, NeoHookean

__all__ = ["LinearElastic", "Material", "NeoHookean"]
