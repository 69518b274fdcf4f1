"""Linear elasticity in small strains of material with directions: of wood, of laminates, of fibres in a matrix."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from isorod.arrays import Array, Index
from isorod.compiled import FAST, njit
from isorod.errors import Checked, InputError, representable
from isorod.material import fibre
from isorod.material.fibre import Fibre, OneFibre
from isorod.material.law import Material
from isorod.material.moduli_kernel import add_both
from isorod.material.places import Places
from isorod.material.points import ACTIVE, BLOCK, ENERGY, FIBRE, GRADIENT, POINTS, ROWS, TANGENT, Compiled

if TYPE_CHECKING:
    from isorod.material.energy import Energy

_F = GRADIENT

# Axes at a smaller angle than this, in radians, have no plane.
_PARALLEL = 1e-6


@njit(**FAST)
def _times(e: tuple[float, ...], p: tuple[float, ...]) -> tuple[float, float, float]:
    """Return the product of a symmetric tensor, components 00, 01, 02, 11, 12, 22, with a vector."""
    return (
        e[0] * p[0] + e[1] * p[1] + e[2] * p[2],
        e[1] * p[0] + e[3] * p[1] + e[4] * p[2],
        e[2] * p[0] + e[4] * p[1] + e[5] * p[2],
    )


@njit(**FAST)
def _dot(p: tuple[float, ...], q: tuple[float, ...]) -> float:
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@njit(**FAST)
def _sum(
    x: float, p: tuple[float, ...], y: float, q: tuple[float, ...], z: float, r: tuple[float, ...]
) -> tuple[float, float, float]:
    """Return ``x p + y q + z r`` of vectors."""
    return x * p[0] + y * q[0] + z * r[0], x * p[1] + y * q[1] + z * r[1], x * p[2] + y * q[2] + z * r[2]


@njit(**FAST)
def _stress(
    e: tuple[float, ...], p: tuple[float, ...], q: tuple[float, ...], c: tuple[float, ...], g: tuple[float, ...]
) -> tuple[float, ...]:
    """Return the stress of a strain, components 00, 01, 02, 11, 12, 22 of both, and the energy.

    Strains along the axes are ``e_ij = n_i.e n_j``; the third is ``p x q``.
    """
    r = (p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0])
    ep, eq, er = _times(e, p), _times(e, q), _times(e, r)
    x, y, z = _dot(p, ep), _dot(q, eq), _dot(r, er)
    xy, xz, yz = _dot(p, eq), _dot(p, er), _dot(q, er)
    sx, sy, sz = c[0] * x + c[1] * y + c[2] * z, c[1] * x + c[3] * y + c[4] * z, c[2] * x + c[4] * y + c[5] * z
    sxy, sxz, syz = 2.0 * g[0] * xy, 2.0 * g[1] * xz, 2.0 * g[2] * yz
    # Stress on the planes across the axes.
    u, v, w = _sum(sx, p, sxy, q, sxz, r), _sum(sxy, p, sy, q, syz, r), _sum(sxz, p, syz, q, sz, r)
    return (
        p[0] * u[0] + q[0] * v[0] + r[0] * w[0],
        p[0] * u[1] + q[0] * v[1] + r[0] * w[1],
        p[0] * u[2] + q[0] * v[2] + r[0] * w[2],
        p[1] * u[1] + q[1] * v[1] + r[1] * w[1],
        p[1] * u[2] + q[1] * v[2] + r[1] * w[2],
        p[2] * u[2] + q[2] * v[2] + r[2] * w[2],
        0.5 * (x * sx + y * sy + z * sz) + xy * sxy + xz * sxz + yz * syz,
    )


@njit(BLOCK, **FAST)
def _block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    c = (constants[0], constants[1], constants[2], constants[3], constants[4], constants[5])
    g = (constants[6], constants[7], constants[8])
    for k in range(np.uint64(POINTS)):
        found = _stress(
            (
                work[ROWS[_F] + k] - 1.0,
                0.5 * (work[ROWS[_F + 1] + k] + work[ROWS[_F + 3] + k]),
                0.5 * (work[ROWS[_F + 2] + k] + work[ROWS[_F + 6] + k]),
                work[ROWS[_F + 4] + k] - 1.0,
                0.5 * (work[ROWS[_F + 5] + k] + work[ROWS[_F + 7] + k]),
                work[ROWS[_F + 8] + k] - 1.0,
            ),
            (work[ROWS[FIBRE] + k], work[ROWS[FIBRE + 1] + k], work[ROWS[FIBRE + 2] + k]),
            (work[ROWS[FIBRE + 3] + k], work[ROWS[FIBRE + 4] + k], work[ROWS[FIBRE + 5] + k]),
            c,
            g,
        )
        work[k], work[ROWS[1] + k], work[ROWS[2] + k] = found[0], found[1], found[2]
        work[ROWS[3] + k], work[ROWS[4] + k], work[ROWS[5] + k] = found[1], found[3], found[4]
        work[ROWS[6] + k], work[ROWS[7] + k], work[ROWS[8] + k] = found[2], found[4], found[5]
        work[ROWS[ENERGY] + k] = found[6]
        work[ROWS[ACTIVE] + k] = 0.0


@njit(**FAST)
def _product(p: tuple[float, ...], q: tuple[float, ...]) -> tuple[float, ...]:
    """Return ``(p q + q p) / 2``."""
    x, y, z = 0.5 * (p[0] * q[1] + p[1] * q[0]), 0.5 * (p[0] * q[2] + p[2] * q[0]), 0.5 * (p[1] * q[2] + p[2] * q[1])
    return p[0] * q[0], x, y, x, p[1] * q[1], z, y, z, p[2] * q[2]


@njit(**FAST)
def _sum_of_nine(
    x: float, d: tuple[float, ...], y: float, e: tuple[float, ...], z: float, f: tuple[float, ...]
) -> tuple[float, ...]:
    """Return ``x d + y e + z f`` of tensors."""
    return (
        *_sum(x, (d[0], d[1], d[2]), y, (e[0], e[1], e[2]), z, (f[0], f[1], f[2])),
        *_sum(x, (d[3], d[4], d[5]), y, (e[3], e[4], e[5]), z, (f[3], f[4], f[5])),
        *_sum(x, (d[6], d[7], d[8]), y, (e[6], e[7], e[8]), z, (f[6], f[7], f[8])),
    )


@njit(TANGENT, **FAST)
def _tangent(work: Array, constants: Array, activation: float) -> None:
    """Add ``sum_ij c_ij E_i E_j``, ``E`` the products of axes, to the moduli."""
    c11, c12, c13, c22, c23, c33 = constants[0], constants[1], constants[2], constants[3], constants[4], constants[5]
    g12, g13, g23 = constants[6], constants[7], constants[8]
    for k in range(np.uint64(POINTS)):
        p = (work[ROWS[FIBRE] + k], work[ROWS[FIBRE + 1] + k], work[ROWS[FIBRE + 2] + k])
        q = (work[ROWS[FIBRE + 3] + k], work[ROWS[FIBRE + 4] + k], work[ROWS[FIBRE + 5] + k])
        r = (p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0])
        d, e, f = _product(p, p), _product(q, q), _product(r, r)
        add_both(work, k, 0.5, d, _sum_of_nine(c11, d, c12, e, c13, f))
        add_both(work, k, 0.5, e, _sum_of_nine(c12, d, c22, e, c23, f))
        add_both(work, k, 0.5, f, _sum_of_nine(c13, d, c23, e, c33, f))
        d, e, f = _product(p, q), _product(p, r), _product(q, r)
        add_both(work, k, 2.0 * g12, d, d)
        add_both(work, k, 2.0 * g13, e, e)
        add_both(work, k, 2.0 * g23, f, f)


class Directed(Checked, Material):
    """A law whose stress is linear in small strains, with three planes of symmetry at right angles at each point."""

    compiled = Compiled(_block, _tangent)
    objective: ClassVar[bool] = False
    linear: ClassVar[bool] = True
    families: ClassVar[int] = 2

    @property
    @abstractmethod
    def engineering(self) -> tuple[Sequence[float], Sequence[float], Sequence[float]]:
        """``E_1, E_2, E_3``, ``nu_12, nu_13, nu_23`` and ``G_12, G_13, G_23``."""

    @cached_property
    def constants(self) -> Array:
        """``C_11, C_12, C_13, C_22, C_23, C_33`` and ``G_12, G_13, G_23`` along the axes, force / area."""
        stiffness = np.linalg.inv(_compliance(*self.engineering[:2]))
        return np.append(stiffness[np.triu_indices(3)], self.engineering[2])

    @cached_property
    def stored(self) -> "Energy":
        """Its energy as an expression of the deformation gradient and the first two axes."""
        import sympy as sp

        from isorod.material import symbols

        return quadratic((symbols.F + symbols.F.T) / 2 - sp.eye(3))


def quadratic(strain: Any) -> "Energy":
    """Return the energy ``e:C e / 2`` of a strain, a symmetric matrix of expressions ``(3, 3)``."""
    import sympy as sp

    from isorod.material import symbols
    from isorod.material.energy import Energy

    first, second = sp.Matrix(symbols.a), sp.Matrix(symbols.b)
    axes = first, second, first.cross(second)
    along = [(axes[i].T * strain * axes[j])[0] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    c = sp.symbols("c11 c12 c13 c22 c23 c33 g12 g13 g23", real=True)
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    whole = sum(
        one * along[i] * along[j] / (2 if i == j else 1) for one, (i, j) in zip(c[:6], pairs, strict=True)
    ) + sum(2 * one * e**2 for one, e in zip(c[6:], along[3:], strict=True))
    return Energy(whole, c)


@dataclass(frozen=True, eq=False)
class Orthotropic(Directed):
    """Linear elasticity in small strains with three axes: ``W = e:C e / 2``, ``e = sym(F) - 1``.

    Parameters
    ----------
    E
        Young's moduli ``E_1, E_2, E_3`` along the axes, force/area.
    nu
        Poisson's ratios ``nu_12, nu_13, nu_23``: ``nu_12`` is how much shorter axis 2 gets when axis 1 is pulled,
        ``nu_12 / E_1 = nu_21 / E_2``.
    G
        Shear moduli ``G_12, G_13, G_23`` in the planes of two axes, force/area.
    axes
        Directions of axes 1 and 2, each a vector ``(3,)``; one of the rod: ``"tangent"``, ``"normal"``,
        ``"binormal"``, ``"radial"`` or ``"around"``; or a function of places (`isorod.material.fibre`).  Of the second
        counts what is at right angles to the first; axis 3 is at right angles to both.

    Raises
    ------
    InputError
        If a value is out of its range or not finite, or some strain would store negative energy.
    """

    E: tuple[float, float, float]
    nu: tuple[float, float, float]
    G: tuple[float, float, float]
    axes: Sequence[Fibre] = ("tangent", "normal")

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("E", "nu", "G"):
            object.__setattr__(self, name, tuple(float(one) for one in getattr(self, name)))
        _check(self.E, self.nu, self.G)
        if len(self.axes) != 2:
            raise InputError(f"{type(self).__name__}: axes: got {len(self.axes)} directions, need two")
        axes = tuple(fibre.checked(one, f"axis {k}") for k, one in enumerate(self.axes, 1))
        object.__setattr__(self, "axes", axes)
        if not self.follows:
            _second(*(np.asarray(one) for one in axes))

    @property
    def engineering(self) -> tuple[Sequence[float], Sequence[float], Sequence[float]]:
        """``E_1, E_2, E_3``, ``nu_12, nu_13, nu_23`` and ``G_12, G_13, G_23``."""
        return self.E, self.nu, self.G

    @property
    def follows(self) -> bool:
        """Whether an axis is a direction of the rod."""
        return any(fibre.follows(one) for one in self.axes)

    def placed(self, places: Places) -> Self:
        """Return the law with its axes at places of a rod."""
        if not self.follows:
            return self
        return replace(self, axes=tuple(fibre.placed(one, places, f"axis {k}") for k, one in enumerate(self.axes, 1)))

    def some(self, places: Index) -> Self:
        """Return the law with the axes of some places, if it has some of each."""
        return replace(self, axes=tuple(fibre.some(one, places) for one in self.axes))

    def fibres(self, shape: tuple[int, ...]) -> Array:
        """Return axes 1 and 2 at points of some shape, shape ``(*shape, 6)``."""
        first, second = (fibre.vectors(one, shape, f"axis {k}") for k, one in enumerate(self.axes, 1))
        return np.concatenate([first, _second(first, second)], axis=-1)


@dataclass(frozen=True, eq=False)
class TransverselyIsotropic(OneFibre, Directed):
    """Linear elasticity in small strains, the same in all directions across a fibre: ``W = e:C e / 2``.

    Parameters
    ----------
    E, E_across
        Young's moduli along and across the fibre, force/area.
    nu
        Poisson's ratio: how much shorter it gets across when it is pulled along.
    nu_across
        How much shorter it gets across when it is pulled across, at right angles.
    G
        Shear modulus in planes along the fibre, force/area; across it is ``E_across / 2(1 + nu_across)``.
    fibre
        Its direction: a vector ``(3,)``; one of the rod: ``"tangent"``, ``"normal"``, ``"binormal"``, ``"radial"`` or
        ``"around"``; or a function of places (`isorod.material.fibre`), such as ``helix(30)``.

    Raises
    ------
    InputError
        If a value is out of its range or not finite, or some strain would store negative energy.
    """

    E: float
    E_across: float
    nu: float
    nu_across: float
    G: float
    fibre: Fibre = "tangent"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not -1.0 < self.nu_across < 1.0:
            raise InputError(f"nu_across: got {self.nu_across:g}, need -1 < nu_across < 1")
        _check(*self.engineering, ("E", "E_across", "E_across"), ("nu", "nu", "nu_across"), ("G", "G", "G across"))
        object.__setattr__(self, "fibre", fibre.checked(self.fibre))

    @property
    def engineering(self) -> tuple[Sequence[float], Sequence[float], Sequence[float]]:
        """``E_1, E_2, E_3``, ``nu_12, nu_13, nu_23`` and ``G_12, G_13, G_23``, the fibre axis 1."""
        E, across = self.E, self.E_across
        shear = across / (2.0 * (1.0 + self.nu_across))
        return (E, across, across), (self.nu, self.nu, self.nu_across), (self.G, self.G, shear)

    def fibres(self, shape: tuple[int, ...]) -> Array:
        """Return the fibre and a direction across it at points of some shape, shape ``(*shape, 6)``."""
        along = fibre.vectors(self.fibre, shape)
        # The axis that it is farthest from.
        far = np.eye(3)[np.argmin(np.abs(along), axis=-1)]
        return np.concatenate([along, _second(along, far)], axis=-1)


def _compliance(E: Sequence[float], nu: Sequence[float]) -> Array:
    """Return the strains along three axes of unit stresses along these, shape ``(3, 3)``."""
    found = np.diag(1.0 / np.array(E))
    for value, (i, j) in zip(nu, ((0, 1), (0, 2), (1, 2)), strict=True):
        found[i, j] = found[j, i] = -value / E[i]
    return found


def _check(
    E: Sequence[float],
    nu: Sequence[float],
    G: Sequence[float],
    names: Sequence[str] = ("E1", "E2", "E3"),
    ratios: Sequence[str] = ("nu12", "nu13", "nu23"),
    shears: Sequence[str] = ("G12", "G13", "G23"),
) -> None:
    """Raise `InputError` if a modulus is not positive, or if a strain would store negative energy."""
    for name, value in zip((*names, *shears), (*E, *G), strict=True):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name}: got {value:g}, need a positive stress")
        representable(name, value)
    for name, value, (i, j) in zip(ratios, nu, ((0, 1), (0, 2), (1, 2)), strict=True):
        most = np.sqrt(E[i] / E[j])
        if not abs(value) < most:
            raise InputError(
                f"{name}: got {value:g}, need less than sqrt({names[i]} / {names[j]}) = {most:.4g} in size: else some "
                "strain stores negative energy"
            )
    # Scaled to ones on the diagonal.
    size = np.sqrt(np.array(E))
    rest = float(np.linalg.det(_compliance(E, nu) * size[:, None] * size))
    if not rest > 1e-12:
        raise InputError(
            f"{', '.join(dict.fromkeys(ratios))}: 1 - nu12 nu21 - nu13 nu31 - nu23 nu32 - 2 nu21 nu32 nu13 is "
            f"{rest:.4g}, need a positive number: else some strain stores negative energy"
        )


def _second(first: Array, second: Array) -> Array:
    """Return the unit vectors of what of the second axes is at right angles to the first, which are unit vectors."""
    across = second - np.sum(first * second, axis=-1, keepdims=True) * first
    size = np.linalg.norm(across, axis=-1, keepdims=True)
    if not size.min(initial=np.inf) > _PARALLEL:
        raise InputError("axes: axis 2 runs along axis 1; take another")
    return np.asarray(across / size)
