"""Rods and bodies that are tied, meshed as one solid: tetrahedra that meet at ties, by gmsh's OpenCASCADE kernel.

Rods are exact volumes (`meshes.occ_rods`), bodies come from STEP files.  All are cut by each other, so that surfaces
which are tied are faces of both sides, which have the same nodes; a mesh of level L has cells of 1/L the size.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from isorod.errors import InputError
from isorod.geometry.rod import Rod
from meshes import occ_rods
from meshes.mesh import Array

# Sizes of cells on level 1: in rods and bodies as multiples of their thickness (for circles the radius), at the edges
# of joints as a fraction of that of the thinner side; what they grow by with the distance from there.
ROD, BODY, NEAR, GROWTH = 1.5, 1.0, 0.5, 0.5

# Fractions by which equal volumes and areas may differ: gmsh computes volumes to 1e-3, areas of facets are
# those of polygons.
_SAME_VOLUME, _SAME_AREA = 0.01, 0.03

# Larger overlaps, as a fraction of the smaller volume, are more than rounding.
_OVERLAP = 1e-4

# Spacing of the points at which joints' edges are looked for, in sizes of cells there.
_SPACING = 0.5


@dataclass(frozen=True, eq=False)
class RodPart:
    """A rod: its region, its label, rings that are parts of their own, and cuts (`occ_rods.volumes`)."""

    name: str
    label: str
    rod: Rod
    radii: Sequence[float] = (0.0, 1.0)
    cuts: Sequence[float] = ()


@dataclass(frozen=True, eq=False)
class BodyPart:
    """A body: its region, its label, its STEP file, box ``(2, 3)`` and volume of its own mesh."""

    name: str
    label: str
    file: str
    step: bytes = field(repr=False)
    box: Array
    volume: float


Part = RodPart | BodyPart


@dataclass(frozen=True, eq=False)
class Join:
    """A tie: numbers of the parts of slave and master, area of the slave's surface, and points of it ``(m, 3)``."""

    name: str
    slave: int
    master: int
    area: float
    points: Array


class _Fragment(NamedTuple):
    """A volume after all were cut by each other, and whose it is."""

    tag: int
    part: int


class Solid:
    """Rods and bodies cut by each other, in the model that gmsh has open.

    Attributes
    ----------
    fragments
        Volumes, each with the number of its part.
    outer, inner
        Faces of the surface, and between fragments of a part, by part.
    joints
        Common faces of two parts, by tie.
    curves
        Round these faces, and those of bodies.

    Raises
    ------
    InputError
        If something cannot be made, or what touches is not what is tied.
    """

    def __init__(self, gmsh: Any, parts: Sequence[Part], joins: Sequence[Join]) -> None:
        self._gmsh, self.parts, self.joins = gmsh, parts, joins
        tools = [(number, one) for number, part in enumerate(parts) for one in _made(gmsh, part)]
        self.fragments, overlaps = self._fragments(tools)
        self._check_volumes()
        sides: dict[int, list[int]] = {}
        for fragment in self.fragments:
            for _, face in gmsh.model.getBoundary([(3, fragment.tag)], combined=False, oriented=False):
                sides.setdefault(face, []).append(fragment.part)
        self.outer = {k: [face for face, own in sides.items() if own == [k]] for k in range(len(parts))}
        self.inner = {k: [face for face, own in sides.items() if own == [k, k]] for k in range(len(parts))}
        common = {face: (min(own), max(own)) for face, own in sides.items() if len(set(own)) == 2}
        self.joints: dict[int, list[int]] = {k: [] for k in range(len(joins))}
        for pair in combinations(range(len(parts)), 2):
            self._join(pair, [face for face, own in common.items() if own == pair], overlaps.get(pair, 0.0))
        bodies = [own for k, own in self.outer.items() if isinstance(parts[k], BodyPart)]
        faces = [(2, face) for own in (*self.joints.values(), *bodies) for face in own]
        self.curves = sorted({edge for _, edge in gmsh.model.getBoundary(faces, combined=False, oriented=False)})

    def _fragments(
        self, tools: Sequence[tuple[int, occ_rods.Volume]]
    ) -> tuple[list[_Fragment], dict[tuple[int, int], float]]:
        """Cut all by all; return the fragments, and the overlap of each pair of parts, as a fraction."""
        occ = self._gmsh.model.occ
        given = [(3, one.tag) for _, one in tools]
        self._sizes = {number: 0.0 for number, _ in tools}
        for number, one in tools:
            # Of nested volumes the largest is all of the part, and a hole is none of it.
            part = self.parts[number]
            last = len(part.radii) - 1 if isinstance(part, RodPart) else one.ring
            sign = 1.0 if one.ring == last else -1.0 if one.ring == 0 else 0.0
            self._sizes[number] += sign * occ.getMass(3, one.tag)
        origins = occ.fragment(given[:1], given[1:])[1] if len(given) > 1 else [given]
        inside: dict[int, dict[int, int]] = {}
        for (number, one), origin in zip(tools, origins, strict=True):
            for dimension, fragment in origin:
                if dimension == 3:
                    rings = inside.setdefault(fragment, {})
                    rings[number] = min(one.ring, rings.get(number, one.ring))
        occ.synchronize()
        fragments: list[_Fragment] = []
        overlaps: dict[tuple[int, int], float] = {}
        for fragment, rings in inside.items():
            of = [number for number, ring in rings.items() if ring > 0]
            if not of:
                occ.remove([(3, fragment)], recursive=True)
                continue
            size = occ.getMass(3, fragment)
            for pair in combinations(sorted(of), 2):
                overlaps[pair] = overlaps.get(pair, 0.0) + size / min(self._sizes[k] for k in pair)
            owner = self._owner(of)
            for number in of:
                if number != owner:
                    self._sizes[number] -= size
            fragments.append(_Fragment(fragment, owner))
        occ.synchronize()
        return fragments, overlaps

    def _owner(self, of: Sequence[int]) -> int:
        """Return whose it is where several are: a rod's rather than a body's, a master's rather than a slave's."""
        rods = [number for number in of if isinstance(self.parts[number], RodPart)] or list(of)
        slaves = {one.slave for one in self.joins if one.slave in rods and one.master in rods}
        return min(rods, key=lambda number: (number in slaves, number))

    def _check_volumes(self) -> None:
        occ = self._gmsh.model.occ
        for number, part in enumerate(self.parts):
            volume = sum(occ.getMass(3, one.tag) for one in self.fragments if one.part == number)
            if abs(volume - self._sizes[number]) > _SAME_VOLUME * self._sizes[number]:
                raise InputError(
                    f"{part.label}: gmsh does not cut it by the others rightly: of a volume of "
                    f"{self._sizes[number]:.5g} {volume:.5g} are left; take a simpler geometry"
                )
            if isinstance(part, BodyPart) and abs(volume - part.volume) > _SAME_AREA * part.volume:
                raise InputError(
                    f"{part.label}: geometry {part.file}: its volume without the rods is {volume:.5g}, that of the "
                    f"mesh {part.volume:.5g}; need the body that is meshed"
                )

    def _join(self, pair: tuple[int, int], faces: Sequence[int], overlap: float) -> None:
        """Record the ties of the common faces of two parts; raises `InputError` unless all of them are tied."""
        ties = {k: one for k, one in enumerate(self.joins) if {one.slave, one.master} == {*pair}}
        area = sum(self._gmsh.model.occ.getMass(2, face) for face in faces)
        first, second = (self.parts[k].label for k in pair)
        if not ties:
            if area > 0.0:
                raise InputError(f"{first} and {second} touch, on an area of {area:.4g}, and nothing ties them there")
            return
        target, name = sum(one.area for one in ties.values()), next(one.name for one in ties.values())
        if not faces:
            raise InputError(
                f"{name}: the surfaces of {first} and {second} are nowhere the same; make them so, or leave the "
                "hole of a rod out of the body's geometry: where both are it is the rod's"
            )
        # A rod that ends within another has one face in the place of its end, of another size.
        within = overlap > _OVERLAP and all(isinstance(self.parts[k], RodPart) for k in pair)
        if not within and abs(area - target) > _SAME_AREA * target:
            how = "let the tied surface be all that touches"
            if area < target:
                how = "leave the hole of a rod out of the body's geometry: where both are it is the rod's"
            raise InputError(
                f"{name}: {first} and {second} are the same surface on an area of {area:.4g}, and {target:.4g} are "
                f"tied; {how}"
            )
        trees = {k: cKDTree(one.points) for k, one in ties.items()}
        for face in faces:
            middle = self._gmsh.model.occ.getCenterOfMass(2, face)
            self.joints[min(trees, key=lambda k: trees[k].query(middle)[0])].append(face)

    def faces(self, number: int) -> list[int]:
        """Return the faces round a part, those common with others too."""
        tied = [k for k, one in enumerate(self.joins) if number in (one.slave, one.master)]
        return [*self.outer[number], *(face for k in tied for face in self.joints[k])]

    def mesh(self, level: int) -> None:
        """Make tetrahedra of degree 2, with straight edges."""
        gmsh = self._gmsh
        for name in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
            gmsh.option.setNumber(f"Mesh.MeshSize{name}", 0)
        gmsh.option.setNumber("Mesh.SecondOrderLinear", 1)
        self._set_sizes(level)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)

    def _set_sizes(self, level: int) -> None:
        """Set the sizes of cells, by entity and place."""
        thick = [self._thickness(number) for number in range(len(self.parts))]
        fields = []
        for number, part in enumerate(self.parts):
            far = (ROD if isinstance(part, RodPart) else BODY) * thick[number] / level
            own = self._field("MathEval", F=f"{far}")
            fields.append(self._field("Restrict", InField=own, **self._entities(number)))
        for k, faces in self.joints.items():
            small = NEAR * min(thick[self.joins[k].slave], thick[self.joins[k].master]) / level
            edges = [edge for _, edge in self._gmsh.model.getBoundary([(2, face) for face in faces], oriented=False)]
            if edges:
                longest = max(self._gmsh.model.occ.getMass(1, edge) for edge in edges)
                count = int(np.ceil(longest / (_SPACING * small))) + 1
                away = self._field("Distance", CurvesList=edges, NumPointsPerCurve=count)
                fields.append(self._field("MathEval", F=f"{small}+{GROWTH / level}*F{away}"))
        self._gmsh.model.mesh.field.setAsBackgroundMesh(self._field("Min", FieldsList=fields))

    def _field(self, kind: str, **given: Any) -> int:
        """Make a field of gmsh's."""
        field = self._gmsh.model.mesh.field
        tag = int(field.add(kind))
        for name, value in given.items():
            kind = "String" if isinstance(value, str) else "Numbers" if isinstance(value, list) else "Number"
            getattr(field, f"set{kind}")(tag, name, value)
        return tag

    def _entities(self, number: int) -> dict[str, list[int]]:
        """Return volumes, faces, curves and points of a part, as fields name them."""
        entities_by_name = {}
        entities = [(3, fragment.tag) for fragment in self.fragments if fragment.part == number]
        for name in ("VolumesList", "SurfacesList", "CurvesList", "PointsList"):
            entities_by_name[name] = sorted({tag for _, tag in entities})
            entities = self._gmsh.model.getBoundary(entities, combined=False, oriented=False) if entities[0][0] else []
        return entities_by_name

    def _thickness(self, number: int) -> float:
        """Return how thick a part is, of a circular rod its radius: volume over half the surface along it."""
        part, occ = self.parts[number], self._gmsh.model.occ
        if isinstance(part, BodyPart):
            faces = {
                face
                for fragment in self.fragments
                if fragment.part == number
                for _, face in self._gmsh.model.getBoundary([(3, fragment.tag)], combined=False, oriented=False)
            }
            return float(3.0 * self._sizes[number] / sum(occ.getMass(2, face) for face in faces))
        return float(_hydraulic(part.rod) * np.diff(part.radii).min())


def _hydraulic(rod: Rod) -> float:
    """Return the smallest of twice the area over the circumference of a rod's sections, of circles the radius."""
    angle = np.linspace(0.0, 2.0 * np.pi, 129)
    outlines = rod.grid(np.stack([np.cos(angle), np.sin(angle)], axis=1), rod.axis.evenly(2))[0]
    sides = np.diff(outlines, axis=1)
    spokes = outlines - outlines.mean(axis=1, keepdims=True)
    area = 0.5 * np.linalg.norm(np.cross(spokes[:, :-1], sides).sum(axis=1), axis=1)
    return float((2.0 * area / np.linalg.norm(sides, axis=2).sum(axis=1)).min())


def _made(gmsh: Any, part: Part) -> list[occ_rods.Volume]:
    """Return the volumes of a part; raises `InputError`, by its name."""
    if isinstance(part, RodPart):
        try:
            return occ_rods.volumes(gmsh, part.rod, part.radii, part.cuts)
        except InputError as problem:
            raise InputError(f"{part.label}: {problem}") from None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "body.step"
        file.write_bytes(part.step)
        try:
            tags = [tag for dimension, tag in gmsh.model.occ.importShapes(str(file)) if dimension == 3]
        except Exception:
            # gmsh raises nothing else.
            tags = []
    if not tags:
        raise InputError(f"{part.label}: geometry {part.file}: gmsh reads no volume from it; save the body as STEP")
    gmsh.model.occ.synchronize()
    boxes = np.array([gmsh.model.occ.getBoundingBox(3, tag) for tag in tags]).reshape(-1, 2, 3)
    box = np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    size = float(np.linalg.norm(np.ptp(part.box, axis=0)))
    if np.abs(box - part.box).max() > _SAME_AREA * size:
        extents = ["; ".join(" to ".join(f"{one:.4g}" for one in axis) for axis in both.T) for both in (box, part.box)]
        raise InputError(
            f"{part.label}: geometry {part.file} reaches from {extents[0]}, its mesh from {extents[1]}; need the same "
            "place and unit (STEP is read in mm)"
        )
    return [occ_rods.Volume(tag, 1) for tag in tags]
