"""Material laws, one a file."""

from isorod.material.law import Material
from isorod.material.linear_elastic import LinearElastic
from isorod.material.neo_hookean import NeoHookean

__all__ = ["LinearElastic", "Material", "NeoHookean"]
