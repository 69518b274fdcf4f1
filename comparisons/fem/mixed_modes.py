"""Vibration modes near and at incompressibility: isorod's default spaces beside Taylor-Hood bricks in dolfinx.

``python -m comparisons.fem.mixed_modes`` prints a table: a free cylinder, the clamped blade, and the scene's spring
about its pulled state.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, NamedTuple

import dolfinx.fem
import numpy as np
import ufl

from comparisons.fem import mixed, quadrature
from comparisons.fem.domain import Domain
from comparisons.fem.modal import RIGID, Body, Modes, Settings, free_unknowns, lowest
from comparisons.fem.statics import Held
from isorod import modal, model, options, statics
from isorod.command import ending
from isorod.fenics import compat
from isorod.geometry.center_line import straight
from isorod.geometry.rod import Rod
from isorod.geometry.section import circle
from isorod.material import LinearElastic, NeoHookean
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring
from isorod.space import Space
from meshes import blade
from meshes.bricks import bricks
from meshes.mesh import Array, Mesh
from meshes.template import o_grid

RATIOS = (0.4999, 0.49999, 0.5)
MODES = 10


def modes(
    domain: Domain,
    law: NeoHookean,
    density: float,
    held: Sequence[str] = (),
    count: int = MODES,
    degree: int = 2,
    about: mixed.Equilibrium | None = None,
) -> Modes:
    """Return the lowest vibration modes, at rest those of linear elasticity.

    Parameters
    ----------
    domain
        The mesh.
    law
        Constants of the material.
    density
        Mass per volume.
    held
        Names of the clamped faces; without any the body is free.
    count
        Number of modes besides the rigid ones.
    degree
        Of the displacement, at least 2; that of the pressure is one less.
    about
        Equilibrium on this mesh, of this law, of elements of this degree; None for the state of rest.

    Others see `comparisons.fem.modal.solve`.
    """
    begin, settings = perf_counter(), Settings()
    if about is None:
        state = dolfinx.fem.Function(compat.function_space(domain.mesh, mixed.element(domain.mesh, degree)))
    else:
        state = about.state
    rule = 2 * degree if domain.shape == "hexahedron" else 2 * degree - 2
    stored = mixed.stored(state, law) * ufl.dx(metadata=quadrature.measure(rule))
    space = state.function_space
    pressures = space.sub(1).collapse()[0].dofmap.index_map.size_global
    free = free_unknowns(space, domain, held, plain=False)
    body = Body(
        state, ufl.split(state)[0], stored, density, None, free, degree, settings, whole=False, pressures=pressures
    )
    return lowest(body, count, 0 if held else RIGID, settings, begin)


def cylinder() -> Rod:
    """Return the cylinder, of radius 1."""
    return straight(6.0).sweep(circle(8))


@dataclass(frozen=True)
class Case:
    """A rod, how it is held, and its meshes, coarse and fine.

    Attributes
    ----------
    title
        In words.
    rod, mesh
        The rod, and its mesh, a coarse or a fine one.
    held
        Faces that are clamped.
    young, density
        Young's modulus at ``nu = 0.3``, of which the shear modulus is kept, and mass per volume.
    pull
        Displacement of the end: modes are about that state.
    degree
        Of the displacement in finite elements, and of their geometry; that of the pressure is one less.
    """

    title: str
    rod: Callable[[], Rod]
    mesh: Callable[[bool], Mesh]
    held: tuple[str, ...] = ()
    young: float = 2.6
    density: float = 1.0
    pull: float = 0.0
    degree: int = 3

    def constants(self, nu: float) -> tuple[float, float]:
        """Return Young's modulus and Poisson's ratio."""
        return self.young / 1.3 * (1.0 + nu), nu

    def ours(self, nu: float, **space: Any) -> modal.Modes:
        """Return isorod's modes, of its default space with these options."""
        where = Space(self.rod(), **space)
        law = (NeoHookean if self.pull else LinearElastic)(*self.constants(nu))
        ends = [model.Support.end(where, face) for face in self.held]
        if self.pull:
            ends[-1] = model.Support.end(where, self.held[-1], displacement=(0.0, 0.0, self.pull))
        rod_model = model.Model([model.Body(where, law, self.density)], ends)
        return modal.solve(rod_model, MODES, state=statics.solve(rod_model) if self.pull else None)

    def theirs(self, nu: float, fine: bool) -> Modes:
        """Return the modes of Taylor-Hood bricks."""
        domain, law = Domain.distribute(self.mesh(fine)), NeoHookean(*self.constants(nu))
        about = None
        if self.pull:
            ends = [Held(self.held[0]), Held(self.held[1], (0.0, 0.0, self.pull))]
            about = mixed.solve(domain, law, ends, degree=self.degree)
        return modes(domain, law, self.density, self.held, degree=self.degree, about=about)


_SPRING = Spring(helix="paper")

CASES = {
    "cylinder": Case(
        "free cylinder, length 6 radii",
        cylinder,
        lambda fine: bricks(cylinder(), o_grid(8, 1, 3), 12 if fine else 6),
    ),
    "blade": Case(
        "clamped blade",
        Blade().rod,
        lambda fine: blade.build("bricks", *((8, 2, 16, 3, 2.0) if fine else (6, 1, 10, 3, 1.5))),
        ("start",),
        Blade.E,
        Blade.density,
    ),
    "spring": Case(
        "pulled spring",
        _SPRING.rod,
        lambda fine: bricks(_SPRING.rod(), o_grid(12 if fine else 8, 1, 2), 72 if fine else 36),
        ("start", "end"),
        Spring.E,
        7.85e-9,
        Spring.travel,
        2,
    ),
}


class Row(NamedTuple):
    """The comparison at one Poisson's ratio.

    Attributes
    ----------
    nu
        Poisson's ratio.
    error
        Of isorod's flexible frequencies the largest relative difference from those of the fine mesh.
    mesh
        What the fine mesh changes of the coarse one's, likewise.
    unknowns, seconds
        Isorod's and, on the fine mesh, the finite elements' unknowns, pressures included, and wall times.
    estimate
        Isorod's of its own error; None about a state.
    """

    nu: float
    error: float
    mesh: float
    unknowns: tuple[int, int]
    seconds: tuple[float, float]
    estimate: float | None


def row(case: Case, nu: float) -> Row:
    """Return the comparison at one Poisson's ratio."""
    case.ours(nu)
    begin = perf_counter()
    ours = case.ours(nu)
    ended = perf_counter()
    coarse, fine = (case.theirs(nu, fine) for fine in (False, True))
    done = perf_counter()
    (body,) = ours.model.bodies
    extra = 0 if body.pressures is None else body.pressures.size
    return Row(
        nu,
        _apart(ours.frequencies[ours.rigid :], fine),
        _apart(coarse.frequencies[coarse.rigid :], fine),
        (ours.model.unknowns + extra, fine.unknowns),
        (ended - begin, done - ended),
        ours.estimate(),
    )


def _apart(frequencies: Array, fine: Modes) -> float:
    return float(np.abs(frequencies / fine.frequencies[fine.rigid :] - 1.0).max())


def _line(result: Row) -> str:
    own = "" if result.estimate is None else f"{100.0 * result.estimate:.2f} %"
    return (
        f"{result.nu:8g} {100.0 * result.error:9.3f} % {100.0 * result.mesh:9.3f} % {own:>9} "
        f"{result.unknowns[0]:9,} {result.unknowns[1]:9,} {result.seconds[0]:8.2f} {result.seconds[1]:8.1f}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        prog="comparisons.fem.mixed_modes", description="Modes near incompressibility beside Taylor-Hood bricks."
    )
    parser.add_argument("--case", choices=CASES, action="append", help="this case alone (repeat for more)")
    parser.add_argument("--nu", type=float, action="append", help="this Poisson's ratio alone (repeat for more)")
    given = parser.parse_args(arguments)
    options.initialize([])
    return ending.run("comparisons.fem.mixed_modes", lambda: _table(given.case or list(CASES), given.nu or RATIOS))


def _table(cases: Sequence[str], ratios: Sequence[float]) -> int:
    for name in cases:
        print(f"{CASES[name].title}: {MODES} frequencies")
        print("      nu  difference  finer mesh  estimate  unknowns  theirs   seconds   theirs")
        for nu in ratios:
            print(_line(row(CASES[name], nu)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
