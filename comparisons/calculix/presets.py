"""Configurations of spring and blade for CalculiX.

Of its elements the 20-node brick with 8 points is fastest at every error: 27 points lock, 8 nodes with incompatible
modes and 10-node tetrahedra need several times its unknowns.  The blade wants two bricks across: one is 5 % too soft.
SPOOLES, the direct solver of Debian's package, beats its conjugate gradients.
"""

from comparisons.fem.presets.family import Family


def _spring(label: str, common: str, *meshes: tuple[int, int]) -> Family:
    return Family(label, common, tuple(f"--around {around} --layers {layers}" for around, layers in meshes))


def _blade(label: str, common: str, *meshes: tuple[int, int, int]) -> Family:
    texts = (f"--along {along} --across {across} --layers {layers}" for along, across, layers in meshes)
    return Family(label, common, tuple(texts))


_R = "--element C3D20R"
SPRING = {
    "quick": (
        _spring("C3D20R", _R, (8, 24), (8, 36), (12, 48), (12, 60)),
        _spring("C3D20", "--element C3D20", (8, 48)),
    ),
    "full": (
        _spring("C3D20R", _R, (8, 24), (8, 36), (8, 48), (12, 48), (12, 60), (16, 84)),
        _spring("C3D20R, a ring", f"{_R} --rings 1", (8, 48), (12, 60)),
        _spring("C3D20", "--element C3D20", (8, 48), (12, 60)),
        _spring("C3D20, a ring", "--element C3D20 --rings 1", (8, 48)),
        _spring("C3D8I", "--element C3D8I --rings 1", (12, 96)),
        _spring("C3D10", "--element C3D10", (8, 48), (12, 60)),
    ),
}
BLADE = {
    "quick": (
        _blade("C3D20R", _R, (4, 2, 16), (5, 2, 20), (6, 2, 24), (6, 3, 24)),
        _blade("C3D8I", "--element C3D8I", (8, 1, 32)),
    ),
    "full": (
        _blade("C3D20R", _R, (4, 2, 16), (5, 2, 20), (6, 2, 24), (6, 3, 24), (8, 4, 32)),
        _blade("C3D20", "--element C3D20", (4, 1, 16), (6, 1, 24), (8, 2, 32)),
        _blade("C3D8I", "--element C3D8I", (8, 1, 32), (12, 2, 48)),
        _blade("C3D10", "--element C3D10", (8, 1, 32)),
    ),
}
