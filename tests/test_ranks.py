"""Every analysis on any number of ranks: what it finds does not depend on how many there are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import test_mixed_contact
from conftest import straight
from models import MODELS, spinning
from petsc4py import PETSc
from surfaces import falling, pin
from test_contact_statics import crossing
from touching import moved

from isorod import InputError, LinearElastic, Muscle, NeoHookean, Space, arc, circle, dynamics, modal, statics
from isorod.assembly.assembler import Assembler
from isorod.model import Body, BodyForce, Contact, Model, Plane, Sphere, Support
from isorod.scenes.biceps import Biceps
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring
from isorod.scenes.strand import Strand

STIFF = NeoHookean(100.0, 0.3)
MUSCLE = Muscle(100.0, 0.3, sigma_max=40.0, m1=35.0, m2=0.5, activation=1.0, fibre=(0.0, 0.0, 1.0))
NEARLY = replace(MUSCLE, nu=0.4999)
SMALL = Biceps(elements=5, end_elements=0, order=1)
TIGHT = {"snes_rtol": 1e-13}


def rod(height=4.0, elements=7, held="xyz", contacts=(), law=STIFF, formulation="displacement"):
    """A rod along z, one end of which may be held."""
    space = Space.paper(straight(4, height=height), elements=elements, degree=2, order=2, quadrature="auto")
    supports = [Support.end(space, "start", held)] if held else []
    return Model([Body(space, law, 2.0, formulation)], supports, contacts=contacts)


def layers(law=STIFF):
    """A rod in layers, one of which is of that law."""
    space = Space(straight(4, height=4.0).with_rings((0.0, 0.6, 1.0)), section_degree=2, elements=5, degree=2)
    return Model([Body(space, [law, NeoHookean(300.0, 0.2)], [2.0, 3.0])], [Support.end(space, "start")])


def swing(model):
    """Velocities that bend, one body after the other."""
    moving = [body.space.positions[:, 2] * body.space.is_control_point for body in model.bodies]
    return np.outer(np.concatenate(moving), [0.1, 0.02, 0.0]).ravel()


def ring():
    """A closed rod, whose first elements are beside the last ones, and what makes it an oval."""
    space = Space.paper(arc(4.0, 360.0).sweep(circle(4, 0.5)), elements=8, degree=2, quadrature="auto")
    model = Model([Body(space, STIFF, density=2.0)])
    velocity = space.positions * space.is_control_point[:, None] * [0.05, -0.05, 0.0]
    return model, velocity.ravel()


def rubbing():
    """Rods that strike each other and slide, one of which a rough plane holds up."""
    low = Space.paper(straight(8, breaks=(0.0, 1.0, 2.0), height=6.0), degree=2, quadrature="auto")
    across = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    thin = moved(straight(8, breaks=(0.0, 1.0, 2.0), radius=0.7, height=4.0), (-2.0, 1.72, 2.5), across)
    bodies = [Body(one, STIFF, density=1.0) for one in (low, Space.paper(thin, degree=2, quadrature="auto"))]
    contacts = [
        Contact(0, 1, 300.0, points=(3, 3), friction=0.3),
        Contact(0, Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)), 300.0, points=(3, 3), friction=0.2),
    ]
    model = Model(bodies, contacts=contacts)
    velocity = np.zeros((model.dofs // 3, 3))
    velocity[int(model.first_node[1]) :] = [0.3, -0.5, -0.1]
    velocity *= model.is_control_point[:, None]
    return model, velocity.ravel()


def pressed():
    """A rod that nothing holds but a sphere that presses it on a plane."""
    space = Space.paper(straight(8, breaks=(0.0, 1.0, 2.0), height=4.0), degree=2, order=2, quadrature="auto")
    under, over = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)), Sphere((0.0, 2.98, 2.0), 2.0)
    contacts = [Contact(0, under, 1e3, points=(3, 4)), Contact(0, over, 1e3, points=(3, 4))]
    return Model([Body(space, STIFF)], [Support.end(space, "start", "xz")], contacts=contacts)


def at_rest(model, **settings):
    """What an equilibrium with contact says."""
    found = statics.solve(model, petsc=TIGHT, **settings)
    told = {
        f"{name} {k}": np.asarray(getattr(one, name))
        for k, one in enumerate(found.contacts)
        for name in ("force", "resultant", "pressure", "positions", "friction", "area", "points_across")
    }
    counts = {name: getattr(found, name) for name in ("load_steps", "cuts", "augmentations")}
    path = np.array([(step.factor, step.push) for step in found.path])
    return {"displacement": found.displacement, "reactions": found.reactions, "path": path} | told | counts


def in_motion(model, *given, **settings):
    """What a motion says."""
    found = dynamics.solve(model, *given, **settings)
    names = (
        "times displacement velocity reactions contact_force contact_area penetration kinetic stored contact_energy "
        "added_kinetic muscle_work dissipated load_work pressure steps"
    )
    return {name: np.asarray(getattr(found, name)) for name in names.split()}


def resumed(file, first, second):
    """A motion the first half of which one communicator takes, and the second another, as its first rank sees it."""
    model, found = rod(law=MUSCLE), {}
    for end_time, comm in ((0.4, first), (0.8, second)):
        if comm.getSize() > 1 or PETSc.COMM_WORLD.getRank() == 0:
            settings = {"outputs": round(10 * end_time), "checkpoint": file, "ramp": 0.6, "comm": comm}
            found = in_motion(model, end_time, 4e-3, velocity=swing(model), resume=end_time > 0.5, **settings)
        PETSc.COMM_WORLD.barrier()
    return found


def equilibria(_):
    """The mixed form; two bodies, also with it; wires with friction, multipliers, more points; one that contact holds.

    On three ranks one has no elements of the first and the last.
    """
    space = Space.paper(straight(4, height=2.0), elements=2, degree=2, order=2, quadrature="auto")
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.1, 0.0, 0.2))
    pulled = layers(NeoHookean(100.0, 0.5))
    away = Support.end(pulled.bodies[0].space, "end", displacement=(0.1, 0.0, 0.2))
    pulled = replace(pulled, supports=[*pulled.supports, away])
    return {
        "mixed": at_rest(Model([Body(space, NeoHookean(100.0, 0.5), formulation="mixed")], ends)),
        "crossing": at_rest(crossing(), load_steps=2),
        "mixed crossing": at_rest(test_mixed_contact.crossing(gap=0.05, friction=0.3), load_steps=2),
        "pulled layers": at_rest(pulled),
        "strand": at_rest(Strand(section_points=6, parts=1, length=10.0, strain=1e-4, friction=0.1).model()),
        "pressed": at_rest(pressed()),
    }


def explicit(_):
    """1,000 steps of one body, which ranks share; more of one that is closed; activation, added mass, and friction."""
    model, (closed, away), (rough, thrown) = rod(), ring(), rubbing()
    step = 0.5 * dynamics.solve(model, 1e-9, outputs=1).critical_step
    return {
        "rod": in_motion(model, 1_000 * step, step, 4, damping=0.05, velocity=swing(model)),
        "ring": in_motion(closed, 2.0, outputs=2, velocity=away),
        "muscle": in_motion(rod(law=MUSCLE, held="z"), 0.5, outputs=2, ramp=0.2),
        "biceps": in_motion(SMALL.model(), 4e-3, 2.5e-5, 2, damping=10.0, ramp=2.5e-3),
        "rubbing": in_motion(rough, 2.0, outputs=2, velocity=thrown),
        "layers": in_motion(layers(MUSCLE), 0.5, outputs=2, ramp=0.2, velocity=swing(layers())),
    }


def implicit(_):
    """A body with a load; two in contact; friction; pressures of an incompressible body, and of a muscle on a plane."""
    model, (rough, thrown) = rod(), rubbing()
    under = Contact(0, Plane((0.0, -1.01, 0.0), (0.0, 1.0, 0.0)), 300.0, points=(3, 4))
    mixed = {"elements": 3, "formulation": "mixed"}
    whole, flexed = rod(law=NeoHookean(100.0, 0.5), **mixed), rod(law=NEARLY, contacts=(under,), **mixed)
    loaded = Model(model.bodies, model.supports, loads=[BodyForce((0.1, 0.0, 0.0))])
    given = {"integrator": "implicit", "petsc": {"snes_rtol": 1e-12}}
    return {
        "rod": in_motion(loaded, 0.2, 0.1, 2, damping=0.1, velocity=swing(model), **given),
        "biceps": in_motion(SMALL.model(), 1e-3, 5e-4, 2, damping=1.0, ramp=2.5e-3, **given),
        "rubbing": in_motion(rough, 0.2, 0.05, 2, velocity=thrown, **given),
        "incompressible": in_motion(whole, 0.2, 0.1, 2, damping=0.1, velocity=swing(whole), **given),
        "rubber in layers": in_motion(layers(NeoHookean(100.0, 0.5)), 0.2, 0.1, 2, velocity=swing(layers()), **given),
        "mixed muscle": in_motion(flexed, 0.4, 0.1, 2, ramp=0.5, velocity=-swing(flexed), **given),
    }


def checkpoints(folder):
    """Resumed on as many ranks, to the last bit; written by one rank, and by all."""
    world, alone = PETSc.COMM_WORLD, PETSc.COMM_SELF
    model = rod(law=MUSCLE)
    whole = in_motion(model, 0.8, 4e-3, 8, ramp=0.6, velocity=swing(model))
    same = resumed(folder / "same", world, world)
    assert all(np.array_equal(same[key], value) for key, value in whole.items())
    return {
        "whole": whole,
        "more": resumed(folder / "more", alone, world),
        "fewer": resumed(folder / "fewer", world, alone),
    }


def surfaces(_):
    """Contact of sections without control points, on outer and inner surfaces, with friction."""
    model, thrown = falling(friction=0.2)
    given = {"integrator": "implicit", "petsc": {"snes_rtol": 1e-12}}
    return {
        "pin": at_rest(pin((4, 5), friction=0.2), load_steps=2),
        "explicit": in_motion(model, 0.1, outputs=2, velocity=thrown),
        "implicit": in_motion(model, 0.06, 0.01, 2, velocity=thrown, **given),
    }


def estimates(_):
    """Those of an error of statics, with pressures and with contact too, and of modes, of a free body too."""
    space = Space.paper(straight(4, height=4.0), elements=3, degree=2, order=1, quadrature="auto")
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.1, 0.0, 0.2))
    bodies = [Body(space, NeoHookean(100.0, nu), 1.0, form) for nu, form in ((0.3, "displacement"), (0.499, "mixed"))]
    found = [statics.solve(Model([body], ends), petsc=TIGHT) for body in bodies]
    found.append(statics.solve(crossing(), load_steps=2, petsc=TIGHT))
    found += [modal.solve(Model(bodies[:1], held), 4, petsc={"eps_tol": 1e-12}) for held in (ends[:1], ())]
    return {"all": {"errors": np.array([one.estimate() for one in found])}}


def assembly(_):
    """What is summed over elements, and what is solved with it."""
    found = {}
    for name, make in MODELS.items():
        solution, assembler = statics.solve(make()), Assembler(make())
        assert solution.ranks == PETSc.COMM_WORLD.getSize()
        x, out, change, product = (assembler.vector() for _ in range(4))
        low, high = x.getOwnershipRange()
        x.array[:] = 0.03 * np.random.default_rng(0).uniform(-1, 1, x.getSize())[low:high]
        matrix = assembler.matrix()
        assembler.residual(x, 0.7, out)
        assembler.tangent(x, 0.7, matrix)
        assembler.load_forces(x, 0.7, 1.0, change)
        vectors = {"residual": out, "load forces": change, "product": matrix * x}
        if assembler.model.bodies[0].density:
            assembler.mass().mult(x, product)
            vectors["mass"] = product
        found[name] = {key: assembler.displacement(vector, 0.0) for key, vector in vectors.items()} | {
            "displacement": solution.displacement,
            "reactions": solution.reactions,
            "moments": solution.moments,
            "norms": solution.residual_norms[:2],
            "energy": assembler.energy(x, 0.7),
            "smallest": assembler.smallest_jacobian(x, 0.7),
            "forces": assembler.reactions(x, 0.7),
        }
    return found


def modes(_):
    """Of a free body, of two, about a state, with pressures, and in a frame that turns; vectors of single modes."""
    space = Space.paper(Spring(helix="paper", section_points=4, coils=1).rod(), elements=4, degree=3)
    start = Support.end(space, "start")
    free, pull = Body(space, LinearElastic(200.0, 0.3), 2.0), Support.end(space, "end", displacement=(0.0, 0.0, 1.0))
    pulled = Model([Body(space, NeoHookean(200.0, 0.3), 2.0)], [start, pull])
    soft = Body(Space.paper(straight(8, height=6.0), degree=4, section_degree=2), LinearElastic(3.0, 0.5), 1.0)
    solved = {
        "free": modal.solve(Model([free]), 8),
        "two": modal.solve(Model([free, free], [start]), 6),
        "pulled": modal.solve(pulled, 6, state=statics.solve(pulled)),
        "incompressible": modal.solve(Model([soft], [Support.end(soft.space, "start")]), 4),
        "spinning": modal.solve(spinning(elements=8), 4),
    }
    if PETSc.COMM_WORLD.getSize() == 5:
        with pytest.raises(InputError, match="a rank has no unknowns"):
            modal.solve(spinning(), 4)
    names = "eigenvalues", "rigid", "below"
    found = {name: {key: np.asarray(getattr(one, key)) for key in names} for name, one in solved.items()}
    found["pulled"]["vectors"] = solved["pulled"].vectors
    return found


def bands(_):
    """Analyses with the factors of bands that ranks share."""
    spring = Spring(
        helix="paper", order=1, degree=3, section_points=6, elements_per_turn=8, coils=2, formulation="displacement"
    )
    pulled = statics.solve(spring.model())
    assert pulled.solver["pc"] == "banded"
    found = {"displacement": pulled.displacement, "reactions": pulled.reactions}
    blade = Blade(preset="paper", section_degree=2, degree=3, elements=9).model()
    for shift in ({}, {"st_shift": 30.0}):
        solved = modal.solve(blade, 6, petsc=shift)
        assert solved.solver["pc"] == "banded" and solved.below == 6
        found[f"frequencies {shift}"] = solved.frequencies
    space = Space.paper(Blade().rod(), elements=8, degree=3)
    found["free"] = modal.solve(Model([Body(space, NeoHookean(1.0, 0.3), density=1.0)], []), 4).frequencies[6:]
    bodies = [Body(Space.paper(spring.rod(), elements=8, degree=3), NeoHookean(1.0, 0.3))] * 2
    held = [Support.end(one.space, "start", body=b) for b, one in enumerate(bodies)]
    pulls = [Support.end(one.space, "end", displacement=(0, 0, 0.5 + b), body=b) for b, one in enumerate(bodies)]
    found["two bodies"] = statics.solve(Model(bodies, held + pulls)).reactions
    return {"all": found}


def record(what, folder):
    """Save what the ranks find together (called under mpirun)."""
    made = Path(folder)
    found = globals()[what](made)
    if PETSc.COMM_WORLD.getRank() == 0:
        np.savez(made / "found.npz", **{f"{name}: {key}": one[key] for name, one in found.items() for key in one})


def of(what, folder):
    record(what, folder)
    return np.load(folder / "found.npz")


@pytest.fixture(scope="module")
def on_one_rank(tmp_path_factory):
    known = {}

    def get(what):
        if what not in known:
            known[what] = of(what, tmp_path_factory.mktemp(what))
        return known[what]

    return get


ERRORS = {"estimates": 1e-6, "equilibria": 1e-9, "explicit": 1e-10, "implicit": 1e-9, "checkpoints": 1e-10} | {
    "surfaces": 1e-9,
    "assembly": 1e-10,
    "modes": 1e-9,
    "bands": 1e-9,
}
# More ranks than processors take turns at every step; five are more than the elements of some.
LONG = [pytest.param(ranks, marks=pytest.mark.slow) for ranks in (3, 5)]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, *LONG])
@pytest.mark.parametrize("what", ERRORS)
def test_results_do_not_depend_on_the_number_of_ranks(what, ranks, on_one_rank, on_ranks, tmp_path):
    expected, error = on_one_rank(what), ERRORS[what]
    on_ranks(ranks, "test_ranks.record(*sys.argv[1:])", what, str(tmp_path))
    found = np.load(tmp_path / "found.npz")
    assert sorted(found) == sorted(expected)
    off = {key: np.abs(found[key] - one).max(initial=0.0) for key, one in expected.items()}
    for key, one in expected.items():
        print(f"{key}: {off[key]:.1e} of {np.abs(one).max(initial=0.0):.3g}")
    for key, one in expected.items():
        allowed = 1e-6 if key.endswith("vectors") else error
        assert off[key] <= allowed * max(1e-3, np.abs(one).max(initial=0.0)), key
