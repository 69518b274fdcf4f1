"""Bodies: approximation space, constitutive law, density and formulation."""

import warnings
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from isorod import choices
from isorod.arrays import Array
from isorod.errors import Checked, InputError, finite, representable
from isorod.geometry.quadrature import ring_of
from isorod.material.along_rod import Laws
from isorod.material.law import Material
from isorod.material.places import Places
from isorod.model.history import rigid_velocity
from isorod.model.joints import warn_of_smooth_joints
from isorod.model.past import Past, gone_through
from isorod.space import choice
from isorod.space.chosen import CHOICES
from isorod.space.space import Space, Table

if TYPE_CHECKING:
    from isorod.space.pressure import Pressures


# Formulations of a body's equilibrium.
FORMULATIONS = ("displacement", "mixed")

# Poisson's ratio from which pressures pay: below, displacements across the section that are chosen err less than 1e-4
# on the spring; at 0.4999 by 2e-3, the mixed formulation by 1e-5 in three times the time.  Frequencies of one coil
# that is pulled are then off by 2.3 and 0.4 %, those of the blade by 0.25 % in both.  Where there are fibres, whose
# stress a pressure of its own mesh does not balance as well, forces of the biceps err by 0.4 % at 0.49, 0.9 % at 0.498
# and 6.5 % at 0.4999 in displacements, and by 1 % with pressures.
_NEARLY, _WITH_FIBRES = 0.49, 0.499

# Pressures that are linear across the section: 1, x, y.
_LINEAR = 3


@dataclass(frozen=True, eq=False)
class Body(Checked):
    """A rod with its displacement space and material.

    Parameters
    ----------
    space
        The displacement space.
    material
        One law for the whole rod, or one for each element of the space or of the rod itself, shape ``(elements,)``;
        where the rod has several rings (`isorod.geometry.rod.Rod.rings`) one for each of these from the inside,
        ``(rings,)``, or for each element and ring ``(elements, rings)``.
    density
        Mass per reference volume, one for the whole rod or of the shape of several laws.
    formulation
        ``"displacement"``, or ``"mixed"``: displacement and pressure (`isorod.assembly.mixed`), which does not lock
        near incompressibility and takes a Poisson's ratio of 0.5; explicit steps do not know it.  Where not given,
        mixed in all else if all laws have a Poisson's ratio of 0.49 or more, with fibres of 0.499, or one of 0.5 and
        all a positive one.

    velocity, spin, spin_center
        Of motions at the start, as of a rigid body: velocity of a point, ``(3,)``, angular velocity, radians per time,
        and the point, the centre of mass where it is not given.

    Attributes
    ----------
    chosen
        Whether the formulation was not given.
    past
        Earlier states, which laws with memory depend on (`after`); None after a motion, where internal variables are
        known at quadrature points only.
    settled
        Whether plastic flow is over, so that stresses and tangents of a state are elastic.

    Raises
    ------
    InputError
        If the number of laws or densities is not that of the elements, a density is negative or not finite, or the
        formulation is not known or not one for the material.
    """

    space: Space
    material: Material | Sequence[Material] | Sequence[Sequence[Material]]
    density: float | Sequence[float] | Sequence[Sequence[float]] = 0.0
    formulation: str | None = None
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin_center: tuple[float, float, float] | None = None
    chosen: bool = field(init=False)
    past: Sequence[Past] | None = field(init=False, default=())
    settled: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(chosen=self.formulation is None)
        elements, rings = self.space.axis.elements, self._rings
        if self._on_places(self.density) is None:
            several = f"each of the {elements} elements" if rings == 1 else f"each of the {rings} rings"
            shape = np.array(self.density, dtype=object).shape
            raise InputError(f"density: got shape {shape}, need one or one for {several}, in rows of one length")
        bad = ~(np.isfinite(self.densities) & (self.densities >= 0.0))
        if bad.any():
            raise InputError(f"density: got {self.densities[bad][0]:g}, need a finite mass per volume, not negative")
        for name in ("velocity", "spin", "spin_center"):
            given = getattr(self, name)
            finite(name, () if given is None else given, "finite components")
        if self.spin_center is not None and not any(self.spin):
            raise InputError("spin_center: the body does not turn; give its spin")
        for value in np.unique(self.densities[self.densities > 0.0]):
            representable("density", float(value))
        if self._on_places(self.material) is None:
            given = len(self.material) if isinstance(self.material, Sequence) else 0
            raise InputError(
                f"material: got {given} laws for {elements} elements, need one law or one an element"
                if rings == 1
                else f"material: got {given} laws for {rings} rings, need one law, one a ring, or such for elements"
            )
        if self.formulation is None:
            self._set(formulation="mixed" if choices.chosen(self._nearly_incompressible) else "displacement")
        if self.formulation not in FORMULATIONS:
            raise InputError(f"formulation: got {self.formulation!r}, need one of {', '.join(FORMULATIONS)}")
        for k, law in enumerate(self.laws):
            if self.formulation == "displacement" and not np.isfinite(law.lame):
                raise InputError(
                    f"material of element {k // rings}: incompressible (nu = 0.5, or a bulk modulus that is infinite); "
                    "that takes formulation 'mixed'"
                )
        warn_of_smooth_joints(self.space.axis, self.laws, self._rings)
        if any(law.kinks for law in self.laws):
            self._follow_kinks()

    @cached_property
    def initial_velocity(self) -> Array:
        """The velocity of the nodes at the start of a motion, shape ``(nodes, 3)``."""
        space = self.space
        return rigid_velocity(space.positions, space.is_control_point, self.velocity, self.spin, self.turned_about)

    @property
    def turned_about(self) -> tuple[float, ...]:
        """The point about which it turns at the start of a motion, ``(3,)``: the ``spin_center``."""
        if self.spin_center is not None or not any(self.spin):
            return self.spin_center or (0.0, 0.0, 0.0)
        masses = self.masses(self.space)
        return tuple((masses @ self.space.positions / masses[self.space.is_control_point].sum()).tolist())

    def masses(self, space: Space) -> Array:
        """Return the integrals of density times the functions of a space on its rod, shape ``(nodes,)``."""
        table = space.tabulate(0, space.axis.elements)
        weights = self.densities_at(table) * table.weights
        masses = np.einsum("etj,etq,qn->ejn", table.axial, weights, table.section[:, 2])
        return np.asarray(np.bincount(space.element_nodes.ravel(), masses.ravel(), space.nodes), dtype=float)

    @property
    def _rings(self) -> int:
        return len(self.space.rod.rings) - 1

    def _on_places(self, given: Any) -> "np.ndarray[Any, np.dtype[Any]] | None":
        """Return what is given for all, some or each of the places as a table ``(elements, rings)``.

        None if it is of another shape.
        """
        table, elements, rings = np.array(given, dtype=object), self.space.axis.elements, self._rings
        if any(isinstance(one, Sequence) for one in table.flat):
            return None
        if table.shape in ((), (rings,)) and (rings > 1 or not table.shape):
            return np.broadcast_to(table, (elements, rings))
        if table.ndim != (1 if rings == 1 else 2):
            return None
        if len(table) == self.space.rod.axis.elements:
            table = table[self.space.own_elements]
        table = table[:, None] if rings == 1 else table
        return table if table.shape == (elements, rings) else None

    @property
    def discretisation(self) -> dict[str, Any]:
        """Space and formulation as they are recorded, and which of their fields were chosen automatically."""
        space = self.space
        kept = {name: getattr(space, name) for name in CHOICES if getattr(space, name) is not None}
        chosen = [*space.chosen, *(["formulation"] if self.chosen and self.formulation == "mixed" else [])]
        named = {"family": space.basis.family, "element": str(space)}
        return {**named, **kept, "formulation": self.formulation, "chosen": chosen}

    @cached_property
    def pressures(self) -> "Pressures | None":
        """The pressure space of the mixed formulation.

        Raises
        ------
        InputError
            If the space has none, or a law is not split for it or has ``nu <= 0``.
        """
        if self.formulation != "mixed":
            return None
        from isorod.space.pressure import Pressures

        for k, law in enumerate(self.laws):
            if not (law.splits and law.lame > 0.0):
                raise InputError(
                    f"material of element {k // self._rings}: the mixed formulation needs a law with an energy of "
                    f"volume change and nu > 0, {type(law).__name__} has none"
                )
        return Pressures(self.space)

    @property
    def has_poor_pressures(self) -> bool:
        """Whether it has pressures that are at most linear across the section, as of order 1."""
        return self.formulation == "mixed" and self.space.basis.pressure_count <= _LINEAR * self._rings

    @cached_property
    def pressure_unit(self) -> float:
        """The unit of the mixed formulation's pressure unknowns: the median shear modulus, force/area."""
        return float(np.median([law.shear_modulus for law in self.laws]))

    def _nearly_incompressible(self) -> bool:
        """Return whether the mixed formulation pays: it is available, and displacements alone may lock."""
        ratios = [getattr(law, "nu", 0.0) if law.splits else 0.0 for law in self.laws]
        least = _WITH_FIBRES if any(law.families for law in self.laws) else _NEARLY
        # An incompressible law needs it, whatever the others are.
        enough = min(ratios) > 0.0 if self._is_incompressible else min(ratios) >= least
        if not enough:
            return False
        try:
            return self.space.basis.pressure_count > 1
        except InputError:
            return False

    @property
    def _is_incompressible(self) -> bool:
        return any(law.lame == np.inf for law in self.laws)

    def in_displacements(self) -> "Body":
        """Return the body in displacements, unless the mixed formulation was requested by the user."""
        if not (self.chosen and self.formulation == "mixed"):
            return self
        return replace(self, formulation="displacement")

    def in_motion(self, integrator: str) -> "Body":
        """Return the body for steps in time, whose automatic quadrature rule also integrates the mass.

        Explicit steps have no pressures (`in_displacements`), and warn where displacements alone will lock.

        Raises
        ------
        InputError
            If explicit steps cannot take the requested formulation, or the law.
        """
        body = self
        dumb = next((law for law in self.laws if law.remembers and "dissipated" not in law.states), None)
        if dumb is not None:
            raise InputError(f"material: {type(dumb).__name__} does not compute its dissipation; use statics")
        if integrator == "explicit":
            if self.formulation == "mixed" and not self.chosen:
                raise InputError(
                    "formulation: got 'mixed', explicit steps take 'displacement' alone; take that, with nu up to "
                    "0.49, or integrator 'implicit'"
                )
            if self._is_incompressible:
                raise InputError(
                    "material: incompressible (nu = 0.5), where no explicit step is stable; take nu up to 0.49, or "
                    "integrator 'implicit'"
                )
            self._warn_of_locking()
            body = self.in_displacements()
        if "quadrature" not in self.space.chosen:
            return body
        formulation = None if body.chosen else body.formulation
        return replace(body, space=replace(self.space, quadrature="auto"), formulation=formulation)

    def _warn_of_locking(self) -> None:
        """Warn of locking where displacements replace the mixed formulation that was chosen automatically."""
        # Only laws with a volumetric split come here, whose nu is a number; orthotropic laws have three.
        if not (self.chosen and self.formulation == "mixed"):
            return
        nu = max(getattr(law, "nu", 0.0) for law in self.laws)
        if nu > _NEARLY:
            warnings.warn(
                f"nu = {nu:.6g}: explicit steps use the displacement formulation, which locks (forces some per cent "
                "too large); use integrator 'implicit', or nu up to 0.49",
                stacklevel=5,
            )

    def _follow_kinks(self) -> None:
        """Take as many points across the section as kinks of the stress need, or warn if fewer are given."""
        rule, needed = self.space.rule, choice.kinked(self.space)
        if "quadrature" in self.space.chosen:
            self._set(space=self.space.integrated(needed))
        elif 2 * rule.radial < needed.radial or 2 * rule.angular < needed.angular:
            problem = "too few points across the section to resolve where it yields, forces err by some per cent"
            warnings.warn(f"quadrature {rule}: {problem}; leave it out, or take {needed}", stacklevel=5)

    @cached_property
    def densities(self) -> Array:
        """The mass per reference volume of each element, and of each of its rings, shape ``(elements rings,)``."""
        return np.asarray(self._on_places(self.density), dtype=float).ravel()

    def densities_at(self, table: Table) -> Array:
        """Return the mass per reference volume at quadrature points, as `at_points` does."""
        return self.at_points(table, self.densities)

    def at_points(self, table: Table, values: ArrayLike) -> Array:
        """Return values of each element, and of each of its rings, at quadrature points.

        Parameters
        ----------
        table
            The points.
        values
            Shape ``(elements rings,)``.

        Returns
        -------
        values
            Shape ``(E, 1, q)``, or 1 for ``q`` if all points of a section have the same.
        """
        own = np.reshape(np.asarray(values, dtype=float), (-1, self._rings))[table.first : table.first + table.elements]
        return own[:, None, :] if self._rings == 1 else own[:, None, ring_of(self.space.rod.rings, table.xi)]

    @cached_property
    def laws(self) -> tuple[Material, ...]:
        """The law of each element, and of each of its rings, shape ``(elements rings,)``."""
        return tuple(np.asarray(self._on_places(self.material)).flat)

    @cached_property
    def linear(self) -> bool:
        """Whether its stiffness is the same in all states."""
        return self.formulation == "displacement" and all(law.linear for law in self.laws)

    @cached_property
    def shear_laws(self) -> tuple[Material, ...]:
        """The laws of displacements alone: without their bulk terms in the mixed formulation."""
        if self.formulation == "displacement":
            return self.laws
        made = {id(law): law.shear for law in self.laws}
        return tuple(made[id(law)] for law in self.laws)

    def laws_at(self, u: Array, xi: ArrayLike) -> Laws:
        """Return the laws at axis parameters and disk points, for deformation gradients ``u.shape + (q, 3, 3)``.

        Parameters
        ----------
        u
            Shape ``(E,)`` or ``(E, t)``, each row within one element; at a knot the element above it is meant.
        xi
            Shape ``(q, 2)``; where two rings meet the outer one is meant.
        """
        elements = np.searchsorted(self.space.axis.breaks[1:-1], u.reshape(u.shape[0], -1)[:, 0], side="right")
        rings = self._rings
        if rings == 1:
            laws = Laws.of([self.laws[e] for e in elements])
        else:
            each = [[self.laws[e * rings + r] for e in elements] for r in range(rings)]
            laws = Laws.in_rings(each, ring_of(self.space.rod.rings, xi))
        laws = laws.placed(Places(self.space.rod, u[..., None], np.asarray(xi, dtype=float))) if laws.follow else laws
        if not laws.remember:
            return laws
        if self.past is None:
            raise InputError(
                "law: states with memory are at quadrature points alone in motions; take stress and energy in statics"
            )
        laws = gone_through(laws, self.past, self.space, u, xi)
        return laws.frozen if self.settled else laws

    @cached_property
    def remembers(self) -> bool:
        """Whether a law of it has a memory."""
        return any(law.remembers for law in self.laws)

    def after(self, past: Sequence[Past] | None, settled: bool = False) -> "Body":
        """Return the body after earlier states: each of its points depends on its own past deformation."""
        (body := copy(self))._set(past=past, settled=settled)
        return body

    def growing(self, over: Callable[[Any], Callable[[float], float]]) -> "Body":
        """Return the body with laws that grow by tables (`isorod.material.law.Material.growing`)."""
        made = {id(law): law.growing(over) for law in self.laws}
        if all(made[id(law)] is law for law in self.laws):
            return self
        laws = [
            [made[id(law)] for law in self.laws[k : k + self._rings]] for k in range(0, len(self.laws), self._rings)
        ]
        material = laws if self._rings > 1 else [law for (law,) in laws]
        return replace(self, material=material, formulation=None if self.chosen else self.formulation)

    @property
    def width(self) -> int:
        """The largest number of data a point among its laws (`isorod.material.law.Material.width`)."""
        return max(law.width for law in self.laws)

    def known(self, table: Table) -> Array:
        """Return the laws' data at quadrature points, ``(E, t, q, width)``, padded with zeros."""
        result = np.zeros((*table.weights.shape, self.width))
        for law, first, last, points in self.laws_at(table.u, table.xi).pieces:
            own = result[first:last, :, points]
            own[..., : law.width] = law.known(own.shape[:-1])
            result[first:last, :, points] = own
        return result
