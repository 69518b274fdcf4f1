"""Every law in motion: how well explicit and implicit steps keep the energy, with and without pressures.

``python -m comparisons.laws.motion [--level quick] [--law NAME]`` writes a table: a clamped cylinder swings and twists
through large strains, ten thousand steps of each kind (two hundred at quick level).
"""

import sys
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from comparisons.laws.scenes import CURVE
from comparisons.measure.study import LEVELS, Run
from comparisons.measure.timing import Clock
from comparisons.report.html import columns, markdown
from isorod import dynamics, options
from isorod.arrays import Array
from isorod.command import ending
from isorod.command.parser import Parser
from isorod.errors import SolveError
from isorod.geometry.center_line import straight
from isorod.geometry.section import circle
from isorod.material import LinearElastic, NeoHookean
from isorod.material.active_muscle import ActiveMuscle
from isorod.material.fibre import helix
from isorod.material.gent import Gent
from isorod.material.holzapfel_gasser_ogden import HolzapfelGasserOgden
from isorod.material.hyperelastic import Hyperelastic
from isorod.material.law import Material
from isorod.material.mooney_rivlin import MooneyRivlin
from isorod.material.muscle import Muscle
from isorod.material.ogden import Ogden
from isorod.material.orthotropic import Orthotropic, TransverselyIsotropic
from isorod.material.st_venant_kirchhoff import StVenantKirchhoff
from isorod.material.yeoh import Yeoh
from isorod.model import Body, Model, Support
from isorod.output import results
from isorod.output.results import write_beside
from isorod.space import Space

LENGTH, RADIUS, SPEED = 2.0, 0.5, 0.3
# Of laws of small strains.
SLOW = 0.01

# Steps of each kind; an implicit one is a hundredth of the slowest period or so, an explicit one a tenth of a critical
# one: its error of energy goes with the square of it, and does not grow with time.
STEPS = {"quick": 200, "full": 10_000}
IMPLICIT, STEP_FRACTION = 0.1, 0.1

# Error of the energy that is asked for.
TOLERANCE = 1e-4

# Poisson's ratios, of displacements alone and with pressures.
RATIOS = {"displacement": 0.4, "mixed": 0.5}
BULK = {"displacement": 14.0 / 3.0, "mixed": np.inf}


def _stretched(law: type[LinearElastic | NeoHookean | Muscle], **more: Any) -> Callable[[str], Material]:
    return lambda form: law(2.0 * (1.0 + RATIOS[form]), RATIOS[form], **more)


def _own(form: str) -> Material:
    """Return a law as a user writes it down."""
    from isorod.material.symbols import I1bar

    return Hyperelastic(0.5 * (I1bar - 3) + 0.02 * (I1bar - 3) ** 2, bulk=BULK[form])


# Of shear moduli about 1, by formulation.
LAWS: dict[str, Callable[[str], Material]] = {
    "linear": _stretched(LinearElastic),
    "transversely-isotropic": lambda form: TransverselyIsotropic(6.0, 2.5, 0.3, 0.35, 1.2, "tangent"),
    "orthotropic": lambda form: Orthotropic((5.0, 3.0, 2.0), (0.3, 0.25, 0.35), (1.2, 1.0, 0.8)),
    "neo-hookean": _stretched(NeoHookean),
    "muscle": _stretched(Muscle, m1=0.5, m2=0.5),
    "active-muscle": _stretched(ActiveMuscle, sigma_max=0.5, m1=0.5, m2=0.5, activation=1.0, curve=CURVE),
    "st-venant-kirchhoff": lambda form: StVenantKirchhoff(2.8, RATIOS[form]),
    "mooney-rivlin": lambda form: MooneyRivlin(0.35, 0.15, BULK[form]),
    "yeoh": lambda form: Yeoh(0.5, -0.05, 0.02, BULK[form]),
    "gent": lambda form: Gent(1.0, 10.0, BULK[form]),
    "ogden": lambda form: Ogden((1.2, -0.2), (2.0, -2.0), BULK[form]),
    "hgo": lambda form: HolzapfelGasserOgden(1.0, 0.5, 0.5, BULK[form], fibre=helix(30.0)),
    "hgo-two": lambda form: HolzapfelGasserOgden(1.0, 0.5, 0.5, BULK[form], fibre=(helix(30.0), helix(-30.0))),
    "own": _own,
}
# Laws that do not split.
WHOLE = ("st-venant-kirchhoff", "transversely-isotropic", "orthotropic")

KINDS = ("explicit, displacement", "implicit, displacement", "implicit, mixed")

TABLE = "motion.md"


def run(study: Run, laws: Sequence[str] = ()) -> None:
    """Set cylinders of these laws (all where none is named) in motion; record each, and write the table too."""
    options.initialize([])
    chosen = [(law, kind) for law in laws or LAWS for kind in KINDS if not (law in WHOLE and kind.endswith("mixed"))]
    records = []
    with study.progress(len(chosen)) as steps:
        for law, kind in chosen:
            with steps.step(f"{law}, {kind}"):
                records.append(study.record("motion", moved(law, kind, STEPS[study.level])))
    text = markdown(*table(records))
    write_beside(study.folder / TABLE, lambda where: where.write_text(text + "\n"))


def cylinder(law: Material, formulation: str) -> Model:
    """Return a cylinder along z, clamped at its start: 36 unknowns, and six pressures."""
    space = Space(straight(LENGTH).sweep(circle(8, RADIUS)), section_degree=2, degree=2, elements=1, quadrature="2x1x2")
    return Model([Body(space, law, 1.0, formulation)], [Support.end(space, "start")])


def thrown(model: Model) -> Array:
    """Return velocities that bend and twist the cylinder, as far as its law is for."""
    x, speed = model.bodies[0].space.positions, SPEED if model.bodies[0].laws[0].objective else SLOW
    bent = np.stack([speed * x[:, 2], 0.0 * x[:, 0], 0.0 * x[:, 0]], axis=1)
    return np.asarray((bent + x[:, 2:] * np.cross([0.0, 0.0, speed], x)).ravel())


def moved(law: str, kind: str, steps: int) -> dict[str, Any]:
    """Return the record of a law in motion."""
    integrator, form = kind.split(", ")
    model = cylinder(LAWS[law](form), form)
    record: dict[str, Any] = {"law": law, "kind": kind, "steps": steps}
    try:
        step = IMPLICIT
        if integrator == "explicit":
            step = STEP_FRACTION * dynamics.solve(model, 1e-9, outputs=1).critical_step
        clock = Clock()
        history = dynamics.solve(model, steps * step, step, 50, velocity=thrown(model), integrator=integrator)
        clock.lap("motion")
    except SolveError as problem:
        return record | {"failure": str(problem)}
    return record | {
        "steps": history.steps,
        "time_step": history.time_step,
        "energy_error": float(np.abs(history.energy_error).max()),
        "momentum_error": float(np.abs(history.momentum_error).max()),
        "stored": float(history.stored.max() / (history.stored + history.kinetic).max()),
        "seconds": clock.seconds["motion"],
    }


def table(records: Iterable[dict[str, Any]]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return head and rows of the table of motions."""

    def number(name: str, form: str) -> Callable[[Any], str]:
        return lambda one: "" if "failure" in one else f"{one[name]:{form}}"

    shown: dict[str, Callable[[Any], object]] = {
        "law": lambda one: one["law"],
        "steps": lambda one: one["kind"],
        "their number": lambda one: one.get("failure") or f"{one['steps']:,}",
        "time step": number("time_step", ".3g"),
        "error of energy": number("energy_error", ".1e"),
        "of momentum": number("momentum_error", ".1e"),
        "stored, largest share": lambda one: "" if "failure" in one else f"{100.0 * one['stored']:.0f} %",
        "s": number("seconds", ".3g"),
    }
    return columns(records, shown)


def keeps(record: dict[str, Any]) -> bool:
    """Whether a motion keeps its energy within `TOLERANCE`."""
    return "failure" not in record and record["energy_error"] <= TOLERANCE


def main(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit code."""
    return ending.run("comparisons.laws.motion", lambda: _main(arguments), "the records written so far are kept")


def _main(arguments: Sequence[str]) -> int:
    parser = Parser(prog="python -m comparisons.laws.motion", description="How well motions of each law keep energy.")
    parser.add_argument("--level", choices=LEVELS, default="full", help="quick: two hundred steps; full: ten thousand")
    parser.add_argument("--law", action="append", choices=LAWS, default=[], help="this law alone (repeat for more)")
    parser.add_argument("--results", default="results", metavar="DIR", help="folder of records and table (results)")
    given = parser.known(arguments)
    results.check_folder(given.results)
    study = Run("laws", given.level, results.make_folder(given.results))
    run(study, given.law)
    print((study.folder / TABLE).read_text(), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
