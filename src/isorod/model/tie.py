"""Ties: surfaces of two bodies, with meshes of their own, that are welded together."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from isorod.errors import Checked, InputError, finite, positive, whole_number
from isorod.model.bond import BondLaw


@dataclass(frozen=True)
class EndFace(Checked):
    """The face at the ``"start"`` or ``"end"`` of a rod, by its index in the model."""

    body: int
    which: str

    def __post_init__(self) -> None:
        super().__post_init__()
        whole_number("end face: body", self.body, 0, 10**9)
        if self.which not in ("start", "end"):
            raise InputError(f"end face: got {self.which!r}, need 'start' or 'end'")

    def __str__(self) -> str:
        return f"{self.which} of body {self.body}"


@dataclass(frozen=True)
class LateralSurface(Checked):
    """The lateral surface of a rod, by its index in the model, or a length of it.

    Parameters
    ----------
    along
        Lengths along the centre line, from the start, the first below the second; the whole rod where not given.  Both
        must be at element boundaries where the space is C0 (`isorod.space.space.Space`, ``knots``), so that what is
        tied ends there.
    surface
        ``"outer"``, or ``"inner"``: that of the hole of a rod that has one.
    touching
        Whether only the part is tied that touches the other surface, within the tie's ``gap`` or, without one, a
        hundredth of the section's size: as the flat side of a strip on another.
    """

    body: int
    along: tuple[float, float] | None = None
    surface: str = "outer"
    touching: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        whole_number("lateral surface: body", self.body, 0, 10**9)
        if self.along is not None:
            finite("lateral surface: along", self.along, "two lengths")
            if not self.along[0] < self.along[1]:
                raise InputError(f"lateral surface: along is from {self.along[0]:g} to {self.along[1]:g}, must ascend")
        if self.surface not in ("outer", "inner"):
            raise InputError(f"lateral surface: got surface {self.surface!r}, need 'outer' or 'inner'")

    def __str__(self) -> str:
        return f"lateral surface of body {self.body}"


@dataclass(frozen=True, eq=False)
class SolidSurface(Checked):
    """Exterior facets of a finite element body, by its index among the model's solids.

    Parameters
    ----------
    facets
        Numbers of facets on this rank, ``(f,)``, as `dolfinx.mesh.MeshTags.find` gives; where not given, all facets
        near the other surface.
    """

    solid: int
    facets: Any = field(default=None, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        whole_number("solid surface: solid", self.solid, 0, 10**9)
        if self.facets is not None:
            self._set(facets=np.asarray(self.facets, dtype=np.int32).ravel())

    def __str__(self) -> str:
        return f"facets of solid {self.solid}"


Surface = EndFace | LateralSurface | SolidSurface

KINDS = ("weld", "slide", "mean")


@dataclass(frozen=True, eq=False)
class Tie(Checked):
    """A weld of two surfaces, whose meshes need not match.

    The displacement of the ``slave`` is the projection in L2, on the traces of its own functions, of the displacement
    of the ``master``: a mortar method whose multipliers are those traces, condensed, so that matrices stay symmetric
    and definite (Wohlmuth, SIAM J. Numer. Anal. 38 (2000) 989-1012).  Where the surfaces do not coincide the master's
    displacement is extrapolated linearly to the slave's points: rigid motions and linear fields pass any gap exactly.

    Parameters
    ----------
    slave, master
        The two surfaces.  The master covers the slave completely: of a rod's end and a larger face the end is the
        slave.  Where either may be, as of a rod in a hole, tractions are better with the rod's as slave.  A master that
        is a rod takes part as a whole.
    kind
        ``"weld"``; ``"slide"``: only displacements along the slave's normal are the same; or ``"mean"``: only mean
        displacement and mean rotation of the slave, so that neither surface is stiffened (a distributing coupling).
    bond
        Of a slide: stiffness of the bond, tangential traction per slip, force / length^3; or points ``(slip,
        traction)`` of a law (`isorod.model.bond.BondLaw`).
    gap
        The largest admissible distance between the two at rest, units of length; where not given a tenth of the
        slave's size, the root of its area over pi.

    Raises
    ------
    InputError
        If a surface does not exist, or both are of one body.
    """

    slave: Surface
    master: Surface
    gap: float | None = None
    kind: str = "weld"
    bond: float | Sequence[tuple[float, float]] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gap is not None:
            positive("tie: gap", self.gap)
        if getattr(self.slave, "touching", False) and self.kind != "weld":
            raise InputError(f"tie: got kind {self.kind!r} of what touches, need 'weld'")
        if self.kind not in KINDS:
            raise InputError(f"tie: got kind {self.kind!r}, need one of {', '.join(KINDS)}")
        if np.ndim(self.bond):
            self._set(bond=tuple((float(slip), float(traction)) for slip, traction in self.bond))  # type: ignore[union-attr]
        try:
            BondLaw(self.bond)
        except InputError as problem:
            raise InputError(f"tie: {problem}") from None
        if self.bond and self.kind != "slide":
            raise InputError(f"tie: got a bond of kind {self.kind!r}, need 'slide'")
        first, second = (
            ("solid", one.solid) if isinstance(one, SolidSurface) else ("body", one.body)
            for one in (self.slave, self.master)
        )
        if first == second:
            raise InputError(f"tie: {first[0]} {first[1]} with itself; name two bodies")
        if self.kind == "weld" and isinstance(self.slave, SolidSurface) and isinstance(self.master, EndFace):
            # Near the rod's edge the facets would follow its smooth functions, although stress is singular there.
            warnings.warn(
                f"tie: {self.slave} as slave of the {self.master} err up to ten times as much as the reverse; "
                "make the rod's end the slave",
                stacklevel=3,
            )

    @property
    def law(self) -> BondLaw | None:
        """The law of the bond, if there is one."""
        return BondLaw(self.bond) if self.bond else None

    def __str__(self) -> str:
        return f"{self.slave} to {self.master}"

    def check(self, index: int, bodies: int, solids: int) -> None:
        """Raise `InputError` if a body or a solid does not exist; ``index`` is the tie's in the model."""
        for one in (self.slave, self.master):
            kind, number, count = ("body", getattr(one, "body", 0), bodies)
            if isinstance(one, SolidSurface):
                kind, number, count = "solid", one.solid, solids
            if number >= count:
                raise InputError(f"tie {index}: {kind} {number} is not one of the model's {count}")
