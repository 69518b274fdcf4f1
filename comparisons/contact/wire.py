"""Pressure between core and wire of a strand, against Hertz' line contact: ``python -m comparisons.contact.wire``.

The strand is the scene's, of 1 + 6 wires, pulled by 0.002; it says how much each length of its lines of contact
carries.  No mesh of a whole wire sees the patch, a hundredth of the radius wide.  A piece of the core and of one wire,
of the scene's shape, does: its section functions are short at the line of contact alone, which is at the same angle
all along.  Backs are drawn together until the middle of the piece carries as much; its ends are free, and many widths
of the patch away.  Pressures are force per reference area, which the pressure itself shortens by 0.3 per cent.

Where a straight core touches a wire that winds round it, the gap opens across the line of contact alone, and what it
opens with is the sum of all four principal curvatures: ``1/R + 1/r - k/(1 - k r)`` with the curvature k of the wire's
axis.
"""

import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from comparisons.contact import hertz
from isorod import statics
from isorod.arrays import Array, Index
from isorod.contact.result import ContactResult
from isorod.errors import InputError
from isorod.geometry.center_line import helix, straight
from isorod.geometry.section import circle
from isorod.material.neo_hookean import NeoHookean
from isorod.model import Body, Contact, Model, Support
from isorod.output import results
from isorod.scenes.strand import Strand
from isorod.space.closer import Patch, closer
from isorod.space.graded import Graded
from isorod.space.space import Space

SCENE = Strand(strain=0.002)

# Of the piece: its length, elements, about the force per length, and what backs come nearer by at first.
LENGTH, ELEMENTS, LOAD, PUSH = 2.0, 2, 42.0, 0.0016

# Control points of the rods, fine arcs round a section, as many as there may be, and half the width in which arcs are
# that short, in half widths of the patch.
POINTS, ARCS, REACH = 8, 1024, 2.0

# Backs are within such an angle of where nothing touches [rad].
BACK = 1.0


class Line(NamedTuple):
    """What a line of contact carries about the middle of its length."""

    load: float  # force per length of the line
    half_width: float  # length, by the second moment of the pressure
    peak: float  # force/area
    exact: hertz.LineContact  # Hertz' at that load


def curvature(scene: Strand = SCENE) -> float:
    """Return the curvature of the gap across the line between core and wire, 1/length."""
    axis = np.sin(scene.lay_angle) ** 2 / scene.layer_radius(1)
    return float(1.0 / scene.core_radius + 1.0 / scene.wire_radius - axis / (1.0 - axis * scene.wire_radius))


def exact(load: float) -> hertz.LineContact:
    """Return Hertz' half width and peak pressure at a force per length."""
    modulus = hertz.modulus(SCENE.E, SCENE.nu, SCENE.E, SCENE.nu)
    return hertz.line_contact(load, modulus, (1.0 / curvature(), np.inf))


def line_angle(scene: Strand = SCENE) -> float:
    """Return the angle between the lines of contact on the core and its axis [rad]."""
    return float(np.arctan2(2.0 * np.pi * scene.core_radius, scene.pitch))


def line_load(scene: Strand = SCENE) -> float:
    """Pull the strand and return the force per length of a line of contact, far from the ends."""
    (found,) = statics.solve(scene.model()).contacts
    middle = np.abs(found.positions[:, 2] / scene.length - 0.5) < 0.25
    length = 6.0 * 0.5 * scene.length / np.cos(line_angle(scene))
    return float((found.areas * found.pressure)[middle].sum() / length)


def piece(push: float = PUSH, arcs: int = ARCS) -> Model:
    """Return core and wire of a short strand, seen finely along their line of contact, and pushed together."""
    scene, turns = SCENE, LENGTH / SCENE.pitch
    core = straight(LENGTH, degree=4).sweep(circle(POINTS, scene.core_radius), twist=360.0 * turns)
    wire = helix(scene.layer_radius(1), scene.pitch, turns).sweep(circle(POINTS, scene.wire_radius))
    bodies, supports = [], []
    for k, (rod, radius) in enumerate(((core, scene.core_radius), (wire, scene.wire_radius))):
        # A little more, so that rounding does not make them shorter.
        angle, size = k * np.pi, 1.0001 * 2.0 * np.pi / arcs * radius
        around = REACH * exact(LOAD).half_width / radius
        basis = closer(rod, [Patch(0.5, angle, size, around, size)]).basis
        assert isinstance(basis, Graded)
        space = Space.paper(rod, elements=ELEMENTS, degree=4, order=1, section_basis=basis, quadrature="8x4")
        middles = 0.5 * (basis.joints[1:] + basis.joints[:-1])
        back = np.flatnonzero(np.cos(middles - angle) < -np.cos(BACK))
        nodes: Index = (np.arange(space.layers)[:, None] * space.layer_nodes + back).ravel()
        bodies.append(Body(space, NeoHookean(scene.E, scene.nu), formulation="displacement"))
        supports.append(Support(nodes, "xyz", (-k * push, 0.0, 0.0), k))
    return Model(bodies, supports, contacts=[Contact(0, 1)])


def measure(found: ContactResult) -> Line:
    """Return what the middle half of the piece's line of contact carries; points of both sides have a part of it."""
    mine = np.abs(found.positions[:, 2] / LENGTH - 0.5) < 0.25
    load, pressure, body = (found.areas * found.pressure)[mine], found.pressure[mine], found.body[mine]
    radius = np.where(body == 0, SCENE.core_radius, SCENE.wire_radius)
    # Round the sections, to which the line is not quite normal.
    aside: Array = np.cos(line_angle()) * radius * np.angle(np.exp(1j * (found.parameters[mine, 1] - np.pi * body)))
    carried = float(load.sum() * np.cos(line_angle()) / (0.5 * LENGTH))
    half_width = 2.0 * float(np.sqrt(load @ aside**2 / load.sum()))
    return Line(carried, half_width, float(pressure.max()), exact(carried))


def main(arguments: Sequence[str]) -> int:
    """Do what the module says."""
    if arguments:
        raise InputError(f"comparisons.contact.wire: got {arguments[0]}, takes nothing")
    wanted = line_load()
    print(f"line load of the strand {wanted:.2f} N/mm")
    push = PUSH
    for _ in range(2):
        (found,) = statics.solve(piece(push)).contacts
        line = measure(found)
        record: dict[str, Any] = {
            "push": push,
            "load": line.load,
            "half_width": line.half_width,
            "half_width_exact": line.exact.half_width,
            "peak": line.peak,
            "peak_exact": line.exact.peak,
            "cells_across": found.cells_across,
        }
        print(results.line(record))
        push *= wanted / line.load
    return 0


if __name__ == "__main__":
    from isorod.command import ending

    sys.exit(ending.run("comparisons.contact.wire", lambda: main(sys.argv[1:]), "nothing is written"))
