"""Pressure between core and wire of a strand, against Hertz' line contact: ``python -m comparisons.contact.wire``.

The strand is the scene's, of 1 + 6 wires, pulled by 0.002; it gives how much each length of its lines of contact
carries.  No mesh of a full wire resolves the patch, a hundredth of the radius wide.  A segment of core and one wire,
of the scene's shape, does: its section functions are short at the line of contact alone, which is at the same angle
all along.  Backs are drawn together until the middle of the segment carries as much; its ends are free, and many widths
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
from isorod.arrays import Index
from isorod.contact.result import ContactResult
from isorod.errors import InputError
from isorod.geometry.center_line import straight
from isorod.geometry.coils import helix
from isorod.geometry.section import circle
from isorod.material.neo_hookean import NeoHookean
from isorod.model import Body, Contact, Model, Support
from isorod.output import results
from isorod.scenes.strand import Strand
from isorod.space.closer import Patch, closer
from isorod.space.graded import Graded
from isorod.space.space import Space

SCENE = Strand(strain=0.002)

# Of the segment: its length, elements, about the force per length, and what backs come nearer by at first.
LENGTH, ELEMENTS, LOAD, PUSH = 2.0, 2, 42.0, 0.0016

# Fine arcs round a section, the last as many as there may be; control points of the rods, and half the width in which
# arcs are that short, in half widths of the patch.
ARCS = 512, 1024, 2048
POINTS, REACH = 8, 2.0

# Axis parameters up to which the segment is its middle, on either side.
MIDDLE = 0.2

# Backs are within such an angle of where nothing touches [rad].
BACK = 1.0


class Line(NamedTuple):
    """The load of a line of contact about the middle of its length."""

    load: float  # force per length of the line
    half_width: float  # length, by the second moment of the pressure
    peak: float  # force/area
    exact: hertz.LineContact  # Hertz' at that load


def curvature() -> float:
    """Return the curvature of the gap across the line between core and wire, 1/length."""
    axis = np.sin(SCENE.lay_angle) ** 2 / SCENE.layer_radius(1)
    return float(1.0 / SCENE.core_radius + 1.0 / SCENE.wire_radius - axis / (1.0 - axis * SCENE.wire_radius))


def exact(load: float) -> hertz.LineContact:
    """Return Hertz' half width and peak pressure at a force per length."""
    modulus = hertz.modulus(SCENE.E, SCENE.nu, SCENE.E, SCENE.nu)
    return hertz.line_contact(load, modulus, (1.0 / curvature(), np.inf))


def line_angle() -> float:
    """Return the angle between the lines of contact on the core and its axis [rad]."""
    return float(np.arctan2(2.0 * np.pi * SCENE.core_radius, SCENE.pitch))


def line_load() -> float:
    """Pull the strand and return the force per length of a line of contact, far from the ends."""
    (contact,) = statics.solve(SCENE.model()).contacts
    middle = np.abs(contact.positions[:, 2] / SCENE.length - 0.5) < 0.25
    length = 6.0 * 0.5 * SCENE.length / np.cos(line_angle())
    return float((contact.areas * contact.pressure)[middle].sum() / length)


def segment(push: float = PUSH, arcs: int = ARCS[1]) -> Model:
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
        space = Space.paper(rod, elements=ELEMENTS, degree=4, order=1, section_basis=basis, quadrature="auto")
        middles = 0.5 * (basis.joints[1:] + basis.joints[:-1])
        back = np.flatnonzero(np.cos(middles - angle) < -np.cos(BACK))
        nodes: Index = (np.arange(space.layers)[:, None] * space.layer_nodes + back).ravel()
        bodies.append(Body(space, NeoHookean(scene.E, scene.nu), formulation="displacement"))
        supports.append(Support(nodes, "xyz", (-k * push, 0.0, 0.0), k))
    return Model(bodies, supports, contacts=[Contact(0, 1)])


def measure(contact: ContactResult) -> Line:
    """Return the load of the middle of the segment's line of contact, to which points of both sides contribute."""
    middle = np.abs(contact.parameters[:, 0] - 0.5) < MIDDLE
    scene, carried, moment, peak = SCENE, 0.0, 0.0, 0.0
    for body, radius, slope in ((0, scene.core_radius, 0.0), (1, scene.wire_radius, scene.lay_angle)):
        mine = middle & (contact.body == body)
        areas, pressure = contact.areas[mine], contact.pressure[mine]
        # Of the strand, for which points stand: round a rod, areas add up to the circle by the length of its axis, half
        # of that for either side.
        length = areas.sum() / (np.pi * radius) * np.cos(slope)
        load = areas * pressure * np.cos(line_angle()) / length
        # Round the sections, to which the line is not quite normal.
        angle = np.angle(np.exp(1j * (contact.parameters[mine, 1] - np.pi * body)))
        carried += float(load.sum())
        moment += float(load @ (np.cos(line_angle()) * radius * angle) ** 2)
        peak = max(peak, float(pressure.max()))
    return Line(carried, 2.0 * float(np.sqrt(moment / carried)), peak, exact(carried))


def main(arguments: Sequence[str]) -> int:
    """Print the comparison."""
    if arguments:
        raise InputError(f"comparisons.contact.wire: got {arguments[0]}, takes nothing")
    target = line_load()
    print(f"line load of the strand {target:.2f} N/mm")
    push = PUSH
    for arcs in ARCS:
        (contact,) = statics.solve(segment(push, arcs)).contacts
        line = measure(contact)
        record: dict[str, Any] = {
            "arcs": arcs,
            "push": push,
            "load": line.load,
            "half_width": line.half_width,
            "half_width_exact": line.exact.half_width,
            "peak": line.peak,
            "peak_exact": line.exact.peak,
            "peak_error": line.peak / line.exact.peak - 1.0,
            "cells_across": contact.cells_across,
        }
        print(results.line(record), flush=True)
        push *= target / line.load
    return 0


if __name__ == "__main__":
    from isorod.command import ending

    sys.exit(ending.run("comparisons.contact.wire", lambda: main(sys.argv[1:]), "nothing is written"))
