"""The displacement space on a rod, and its tables, which do not change during an analysis."""

from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Real
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isorod import memory
from isorod.arrays import Array, Index
from isorod.errors import Checked, FoldedRodError, InputError
from isorod.geometry.axis import Axis
from isorod.geometry.disk import check_count
from isorod.geometry.quadrature import WHOLE, Rule, axis_points, section_points
from isorod.geometry.rod import Rod, section_gradient
from isorod.geometry.section import refinement_turn
from isorod.space import choice, chosen
from isorod.space.basis import SectionBasis
from isorod.space.graded import Graded
from isorod.space.polyharmonic import Polyharmonic
from isorod.space.polynomial import polynomials
from isorod.tensors import inverse

# Jacobian matrices, their inverses, and intermediate arrays.
_BYTES_A_POINT = 8 * 32


@dataclass(frozen=True, eq=False)
class Space(Checked):
    """Displacements ``sum_jl S_l(xi) R_j(u) d_jl`` on a rod, ``S_l`` the functions of a section basis.

    Nodes are numbered layer by layer: node ``j count + l`` is that of ``S_l R_j``; a closed rod's last layer is its
    first.
    Defaults are chosen from the rod's shape (`isorod.space.choice`), and the attributes then hold the choice; `paper`
    makes the paper's element.  Refinements nest (a degree at the same continuity), and none changes the geometry.

    Parameters
    ----------
    rod
        The geometry.
    elements
        Number of elements along the axis: a multiple of the rod's own.
    degree
        Degree along the axis, from the rod's own to 6.
    continuity
        Continuity at knots the rod does not have, ``0 .. degree - 1``; by default ``degree - 3``, at least 0.
    order
        Polyharmonic order ``K`` of functions of control points (`isorod.space.polyharmonic`), 1 to 6; small contact
        patches need these.
    section_points
        Number of control points ``n`` round the section for them: a multiple of the rod's own, by default equal.
    quadrature
        ``"auto"``, ``"full"``, ``"paper"``, ``"RxS"`` or ``"RxSxT"`` (see `isorod.geometry.quadrature`).
    section_degree
        Polynomials of this degree in the section's coordinates (`isorod.space.polynomial`; of a rod with rings,
        `isorod.space.ringed`) instead of functions of control points (`isorod.space.polyharmonic`).
    section_basis
        Any other functions instead of both (`isorod.space.basis`).
    knots
        Places along the axis at which elements are cut, C3, or C0 at places named twice, as where a load acts on a
        section.  By default, where elements are chosen, those that resolve the boundary layers at both ends
        (`isorod.space.choice.boundary_layers`), else none.

    Attributes
    ----------
    chosen
        Names of those parameters that were not given.

    Raises
    ------
    InputError
        If the numbers do not fit each other.
    """

    rod: Rod
    elements: int | None = None
    degree: int | None = None
    continuity: int | None = None
    quadrature: str | None = None
    order: int | None = None
    section_points: int | None = None
    section_degree: int | None = None
    section_basis: SectionBasis | None = None
    knots: tuple[float, ...] | None = None
    chosen: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(**chosen.choices(self))
        # Errors are raised now, not when an analysis first needs these.
        self._set(basis=chosen.basis(self))
        self.axis, self.rule  # noqa: B018

    @classmethod
    def paper(
        cls,
        rod: Rod,
        elements: int | None = None,
        degree: int | None = None,
        continuity: int | None = None,
        quadrature: str = "full",
        order: int = 1,
        section_points: int | None = None,
        section_degree: int | None = None,
        section_basis: SectionBasis | None = None,
    ) -> "Space":
        """Return the paper's element: by default ``order`` 1 and the rod's own control points and axis.

        The axis is as smooth as its degree and the rod allow.  The paper's own rule is ``quadrature="paper"``, which
        under-integrates the stiffness.
        """
        own = section_degree is None and section_basis is None
        degree = rod.axis.degree if degree is None else degree
        return cls(
            rod,
            rod.axis.elements if elements is None else elements,
            degree,
            degree - 1 if continuity is None and isinstance(degree, Real) else continuity,
            quadrature,
            order if own or order != 1 else None,
            section_points,
            section_degree,
            section_basis,
            (),
        )

    def __str__(self) -> str:
        """Return a description, the family of elements first (`isorod.space.basis.FAMILIES`)."""
        smooth = f"C{self.continuity}" if self.axis.elements != 1 else "alone"
        short = f", {len(set(self.knots))} of them short" if self.knots else ""
        along = f"{self.axis.elements} elements of degree {self.degree}, {smooth}{short}"
        return f"{self.basis}; {along}; quadrature {self.rule}"

    def matches(self, other: "Space") -> bool:
        """Whether the nodes of another space are those of this one."""
        return self is other or (self.nodes == other.nodes and np.allclose(self.positions, other.positions))

    def __repr__(self) -> str:
        return f"Space({self.layers} layers of {self.layer_nodes} nodes)\n  {self}\n  on {self.rod!r}"

    @cached_property
    def basis(self) -> SectionBasis:
        """The section functions."""
        refined = self.order not in (None, 1) or self.section_points not in (None, self.rod.section_points)
        if self.section_basis is not None:
            if refined or self.section_degree is not None:
                raise InputError("section basis: it takes the place of order, section points and section degree")
            return self.section_basis
        if self.section_degree is not None:
            if refined:
                raise InputError(
                    "section degree: polynomials take the place of order and section points; leave those out"
                )
            if self.rod.rings == WHOLE:
                return polynomials(self.rod, self.section_degree)
            # Imported late: only rods with rings need it.
            from isorod.space.ringed import Ringed

            return Ringed(self.rod, self.section_degree)
        if self.rod.rings != WHOLE:
            raise InputError("section degree: got none, need one such as 4: hollow and layered rods take polynomials")
        return Polyharmonic(self.points_around, cast(int, self.order), self.turn)

    @cached_property
    def axis(self) -> Axis:
        """Axis of the displacement space."""
        rod_elements, elements = self.rod.axis.elements, cast(int, self.elements)
        if elements < rod_elements or elements % rod_elements:
            raise InputError(
                f"elements: got {elements}, need a multiple of the {rod_elements} elements of the rod itself"
            )
        even = self.rod.axis.refine(elements // rod_elements, self.degree, self.continuity)
        return even.with_knots(self.knots, choice.SMOOTH) if self.knots else even

    @cached_property
    def own_elements(self) -> Index:
        """The element of the rod itself in which each element lies, shape ``(elements,)``."""
        middles = 0.5 * (self.axis.breaks[:-1] + self.axis.breaks[1:])
        return np.searchsorted(self.rod.axis.breaks, middles) - 1

    def integrated(self, rule: Rule) -> "Space":
        """Return the space with another quadrature rule."""
        (space := copy(self))._set(quadrature=str(rule), rule=rule)
        return space

    @cached_property
    def rule(self) -> Rule:
        """Quadrature rule."""
        if self.quadrature == "auto":
            return self.basis.auto(self.axis.degree)
        if self.quadrature == "full":
            return self.basis.full(self.axis.degree)
        return Rule.parse(cast(str, self.quadrature), self.axis.degree)

    @cached_property
    def multiple(self) -> int:
        """Number of this space's section arcs in one of the rod's."""
        rod_points = self.rod.section_points
        requested = rod_points if self.section_points is None else self.section_points
        if isinstance(self.section_basis, Graded):
            requested = self.section_basis.fine
        if requested < rod_points or requested % rod_points:
            raise InputError(f"section points: got {requested}, need a multiple of the {rod_points} of the rod itself")
        return check_count(requested) // rod_points

    @property
    def points_around(self) -> int:
        """Number of control points round the section, ``n``; of graded functions, of the fine arcs."""
        return self.rod.section_points * self.multiple

    @property
    def turn(self) -> float:
        """Angle of the first control point, radians."""
        return refinement_turn(self.rod.section_points, self.multiple)

    @property
    def layers(self) -> int:
        """Number of distinct layers of control points."""
        return self.axis.count - self.rod.closed

    @property
    def layer_nodes(self) -> int:
        """Number of nodes in a layer: that of the section functions."""
        return self.basis.count

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return self.layers * self.layer_nodes

    @cached_property
    def is_control_point(self) -> NDArray[np.bool_]:
        """Whether a node is a control point, shape ``(nodes,)``.

        Control points are the nodes whose functions form the partition of unity: a translation of the rod moves all of
        them by the same, and no other node; only their forces add up to the resultant.
        """
        return np.tile(self.basis.is_control_point, self.layers)

    @cached_property
    def positions(self) -> Array:
        """Coefficients of the rod's own map, shape ``(nodes, 3)``."""
        polygons = self.rod.axis.transfer(self.axis, self.rod.control_points)[: self.layers]
        return self.basis.positions(polygons).reshape(-1, 3)

    @cached_property
    def element_layers(self) -> Index:
        """Layers of each element, shape ``(elements, p + 1)``."""
        return (self.axis.first_function[:, None] + np.arange(self.axis.degree + 1)) % self.layers

    @cached_property
    def element_nodes(self) -> Index:
        """Nodes of each element, layer by layer, shape ``(elements, (p + 1) count)``."""
        nodes = self.element_layers[:, :, None] * self.layer_nodes + np.arange(self.layer_nodes)
        return nodes.reshape(self.axis.elements, -1)

    def end(self, which: str) -> int:
        """Return the index of the ``"start"`` or ``"end"`` in arrays along the axis: 0 or -1.

        Raises
        ------
        InputError
            If the rod is closed, or it is neither.
        """
        if self.rod.closed:
            raise InputError(f"end: got {which!r}, but a closed rod has none")
        if which not in ("start", "end"):
            raise InputError(f"end: got {which!r}, need 'start' or 'end'")
        return 0 if which == "start" else -1

    def section_rule(self, rule: Rule) -> tuple[Array, Array]:
        """Return points and weights of a rule across the section (`isorod.geometry.quadrature.section_points`)."""
        if isinstance(self.section_basis, Graded):
            return self.section_basis.points(rule)
        return section_points(self.points_around, rule, self.turn, self.rod.rings)

    def tabulate(self, first: int, last: int, rule: Rule | None = None) -> "Table":
        """Return the functions and the geometry at the quadrature points of the elements ``first .. last - 1``.

        The points are those of ``rule``, by default the space's own.

        Raises
        ------
        InputError
            If the tables do not fit in memory.
        FoldedRodError
            If the Jacobian is not positive at one of them.
        """
        rule = self.rule if rule is None else rule
        in_section = self.points_around * rule.radial * rule.angular * (len(self.rod.rings) - 1)
        count = (last - first) * rule.axial * in_section
        memory.ask(_BYTES_A_POINT * count, f"the geometry at {count:,} quadrature points")
        xi, area = self.section_rule(rule)
        u, length = (points[first:last] for points in axis_points(self.axis, rule.axial))
        values, gradients = self.basis.functions(xi)
        _, axial, slopes = self.axis.local(u.ravel())
        shape = (*u.shape, self.axis.degree + 1)
        inverses, det = self.rod.inverse_jacobians(xi, u.ravel())
        inverses, det = inverses.reshape(*u.shape, -1, 3, 3), det.reshape(*u.shape, -1)
        if det.size and not det.min() > 0.0:
            e, t, q = np.unravel_index(int(np.argmin(det)), det.shape)
            raise FoldedRodError(
                f"the rod folds in element {first + e} at u = {u[e, t]:.4g}, disk point "
                f"({xi[q, 0]:.3f}, {xi[q, 1]:.3f}): Jacobian determinant {det[e, t, q]:.3g}, must be positive"
            )
        return Table(
            first=first,
            u=u,
            xi=xi,
            section=np.ascontiguousarray(np.concatenate([gradients, values[:, :, None]], axis=2).transpose(0, 2, 1)),
            axial=axial.reshape(shape).copy(),
            slopes=slopes.reshape(shape).copy(),
            inverse=inverses,
            weights=det * length[:, :, None] * area,
        )

    def displacement(self, nodal: ArrayLike, xi: ArrayLike, u: ArrayLike) -> tuple[Array, Array]:
        """Return displacements and deformation gradients on a grid of disk and axis points.

        Parameters
        ----------
        nodal
            Nodal displacements, shape ``(nodes, 3)``.
        xi, u
            Disk points ``(q, 2)`` and axis parameters ``(t,)``.

        Returns
        -------
        displacement, deformation_gradient
            Shapes ``(t, q, 3)`` and ``(t, q, 3, 3)``.
        """
        nodal = np.asarray(nodal, dtype=float).reshape(self.layers, self.layer_nodes, 3)
        values, gradients = self.basis.functions(xi)
        first, axial, slopes = self.axis.local(u)
        near = nodal[(first[:, None] + np.arange(self.axis.degree + 1)) % self.layers]
        section = np.einsum("tj,tjia->tia", axial, near)
        along = np.einsum("tj,tjia->tia", slopes, near)
        gradient = section_gradient(values, gradients, section, along)
        _, jacobian = self.rod.grid(xi, u)
        return values @ section, np.eye(3) + gradient @ inverse(jacobian)[0]


class Table(NamedTuple):
    """Functions and geometry at the quadrature points of consecutive elements, the first of them ``first``.

    With ``E`` elements, ``t`` points along each, ``q`` in the section, ``n`` section functions, degree ``p``: ``u``
    ``(E, t)`` and ``xi`` ``(q, 2)`` are the points; ``section`` ``(q, 3, n)`` holds ``dT/dxi_1, dT/dxi_2, T``;
    ``axial`` and ``slopes`` ``(E, t, p + 1)`` hold ``R`` and ``dR/du``; ``inverse`` ``(E, t, q, 3, 3)`` is
    ``d(xi_1, xi_2, u)/dx``; ``weights`` ``(E, t, q)`` are volumes.
    """

    first: int
    u: Array
    xi: Array
    section: Array
    axial: Array
    slopes: Array
    inverse: Array
    weights: Array

    @property
    def elements(self) -> int:
        """Number of elements."""
        return self.u.shape[0]

    def part(self, elements: "slice | Index", points: "slice | Index") -> "Table":
        """Return the table of some elements and of some points of their sections; slices are not copied."""
        everywhere = isinstance(points, slice)
        near, weights, xi = self.inverse[elements], self.weights[elements], self.xi[points]
        xi.flags.writeable = False
        return Table(
            self.first,
            self.u[elements],
            xi,
            self.section if everywhere else self.section[points],
            self.axial[elements],
            self.slopes[elements],
            near if everywhere else np.ascontiguousarray(near[:, :, points]),
            weights if everywhere else np.ascontiguousarray(weights[:, :, points]),
        )
