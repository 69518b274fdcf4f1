"""Finite element bodies of a scene file: a mesh with groups of facets, a law, what holds and loads it."""

import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from isorod.errors import InputError
from isorod.files import schema
from isorod.files.document import Place
from isorod.files.form import Call, Name, call, choice
from isorod.files.meshes import Geometry
from isorod.files.msh import Grid
from isorod.files.xdmf import Facets

if TYPE_CHECKING:
    from isorod.fenics.groups import Groups
    from isorod.fenics.loads import Held, Load
    from isorod.fenics.solid import Solid


class OfBody(NamedTuple):
    """A body in the file except its law, in names of groups.

    Attributes
    ----------
    name
        Of the body.
    place
        Where it is.
    grid
        Its mesh.
    held, loads
        What holds and loads it.
    geometry
        A STEP file of it, if one is named.
    """

    name: str
    place: Place
    grid: Grid
    held: "Sequence[Held]"
    loads: "Sequence[Load]"
    geometry: Geometry | None


def solid(
    mesh: Grid,
    degree: int = 2,
    density: float = 0.0,
    facets: Facets | None = None,
    geometry: Geometry | None = None,
) -> tuple[Grid, int, float]:
    """Return what makes a finite element body (`isorod.fenics.solid.Solid`), which takes dolfinx.

    Parameters
    ----------
    mesh
        Tetrahedra or hexahedra, of degree 1 or 2, in the units of the rods: `.msh` of gmsh, version 2.2 or 4.1, or
        `.xdmf` of dolfinx or meshio. Supports, loads and ties know facets by the names of groups: the physical groups
        of gmsh's surfaces; of XDMF the names of mesh tags, for all their facets, and the numbers in these.
    degree
        Of the displacement, 1 or 2; one of 1 locks in bending.
    density
        Mass per reference volume.
    facets
        An `.xdmf` file of tagged facets, with the points of the mesh, where these are not in the mesh's own: so does
        meshio write them.
    geometry
        The body as a STEP file (`.step`, `.stp`), in the place and the unit of the mesh, where STEP is taken in mm: of
        `isorod compare` alone, which meshes rods and bodies anew as one solid. A hole that a rod fills may be left out.
    """
    return mesh, degree, density


def held(group: str, components: str = "xyz", displacement: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> "Held":
    """Return what holds the facets of a group.

    Parameters
    ----------
    group
        Which facets.
    components
        Letters of ``"xyz"``.
    displacement
        At load factor 1, shape ``(3,)``, units of length.
    """
    from isorod.fenics.loads import Held

    if not components or set(components) - set("xyz"):
        raise InputError(f"components: got {components!r}, need some of 'xyz'")
    return Held(group, components, displacement)


def force(force: tuple[float, float, float], group: str) -> "Load":
    """Return a force spread evenly over the facets of a group, at rest.

    Parameters
    ----------
    force
        In all, at load factor 1, shape ``(3,)``.
    group
        Which facets.
    """
    from isorod.fenics.loads import Load

    return Load(group, force, total=True)


def traction(traction: tuple[float, float, float], group: str) -> "Load":
    """Return a force per reference area on the facets of a group.

    Parameters
    ----------
    traction
        At load factor 1, shape ``(3,)``.
    group
        Which facets.
    """
    from isorod.fenics.loads import Load

    return Load(group, traction)


def pressure(pressure: float, group: str) -> "Load":
    """Return a pressure on the facets of a group, along their normals at rest.

    Parameters
    ----------
    pressure
        Force per area at load factor 1; positive where it pushes the surface into the body.
    group
        Which facets.
    """
    from isorod.fenics.loads import Load

    return Load(group, pressure=pressure)


def body_force(density: tuple[float, float, float]) -> "Load":
    """Return a uniform force per reference volume, such as weight `density * gravity`.

    Parameters
    ----------
    density
        Force per reference volume at load factor 1, shape `(3,)`.
    """
    from isorod.fenics.loads import Load

    return Load(None, density)


class SolidPlan:
    """A finite element body as the file describes it.

    Attributes
    ----------
    grid
        Its mesh.
    gravity
        The acceleration that acts on it, if any.

    Raises
    ------
    InputError
        If something is not known, missing, or not of its kind.
    """

    KEYS = ("law", "held", "load")

    def __init__(self, place: Place, table: Mapping[str, Any]) -> None:
        self.place = place
        self.gravity: dict[str, Any] | None = None
        own = {key: one for key, one in table.items() if key not in self.KEYS}
        known = (*schema.SOLID.parameters, *self.KEYS)
        for key in own:
            if key not in known:
                raise (place / key).unknown_key(known)
        self._solid = call(place, schema.SOLID, own)
        self.grid: Grid = self._solid.arguments["mesh"]
        facets = self._solid.arguments.get("facets")
        if facets is not None:
            self.grid = facets.on(self.grid)
        self._files = " and ".join(str(own[key]) for key in ("mesh", "facets") if key in own)
        if "law" not in table:
            raise place.error(f"law is missing: one of {', '.join(schema.LAWS)}")
        self.law = choice(place / "law", schema.LAWS, table["law"])
        self._held = [self._one_held(at, one) for at, one in _several(place / "held", table.get("held", []))]
        self._loads = [
            choice(at, schema.SOLID_LOADS, one) for at, one in _several(place / "load", table.get("load", []))
        ]
        for one in (*self._held, *self._loads):
            self._group(one)

    def __str__(self) -> str:
        groups = ", ".join(self.grid.groups) or "none"
        return f"{self._files}, groups {groups}"

    def _one_held(self, place: Place, value: Any) -> Call:
        if isinstance(value, str):
            return Call(place, schema.HELD, {"group": (value, place)})
        return call(place, schema.HELD, place.table(value))

    def _group(self, one: Call) -> dict[str, str]:
        """Return the group that a call names, having made sure that it is there."""
        group = one.arguments.get("group")
        if not isinstance(group, Name):
            return {}
        group.among(self.grid.groups)
        return {"group": group.name}

    def of_body(self, name: str) -> OfBody:
        """Return the table of the body of that name."""
        held = [one.make(**self._group(one)) for one in self._held]
        loads = [one.make(**self._group(one)) for one in self._loads]
        if self.gravity is not None:
            density = self._solid.make()[2]
            if not density > 0.0:
                raise self.place.error("density: gravity acts on a body that has one")
            if self.gravity.get("history") is not None:
                raise self.place.error("finite element bodies know no history of gravity; leave it out")
            x, y, z = self.gravity["acceleration"]
            loads.append(body_force((density * x, density * y, density * z)))
        return OfBody(name, self.place, self.grid, held, loads, self._solid.arguments.get("geometry"))

    def body(self) -> "tuple[Solid, Groups]":
        """Return the body, and the facets of its groups."""
        show = warnings.showwarning
        try:
            from isorod.fenics import groups
            from isorod.fenics.solid import Solid
        except ImportError as problem:
            raise self.place.error(
                f"finite element bodies need dolfinx, and {problem.name} is not installed (docs/installation.md)"
            ) from None
        finally:
            # ffcx would have all warnings in its log.
            warnings.showwarning = show
        _, degree, density = self._solid.make()
        if degree not in (1, 2):
            raise (self.place / "degree").error(f"got {degree}, need 1 or 2")
        if not density >= 0.0:
            raise (self.place / "density").error(f"got {density:g}, need a mass per volume, not negative")
        described, law = self.of_body(""), self.law.make()
        with self.place.locating(self._solid.keys):
            grid_groups = groups.Groups(*self.grid)
            space = groups.space_of(grid_groups, degree)
            conditions, external = (
                groups.conditions(space, grid_groups, described.held),
                groups.external(space, grid_groups, described.loads),
            )
            return Solid(space, law, density, conditions, external), grid_groups


def _several(place: Place, value: Any) -> list[tuple[Place, Any]]:
    """Return each of a list, or the only one, and where it stands."""
    return [(place / k, one) for k, one in enumerate(value)] if isinstance(value, list) else [(place, value)]
