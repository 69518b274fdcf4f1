"""Derivatives along the path of load steps: runs beside, Taylor's remainder, identities of scale, ranks, kinks."""

from math import exp

import numpy as np
import pytest
from petsc4py import PETSc
from test_design_runs import METAL
from test_rates import logarithmic
from test_rates_contact import RING

from isorod import InputError, choices, files, statics
from isorod.design import derivatives, parameters
from isorod.statics import along_path
from isorod.statics.derivatives import refuse

pytestmark = pytest.mark.filterwarnings("ignore:stress along the rod")

TIGHT = {"snes_rtol": 1e-13}

# Bent and pulled past yield, and let go in part.
BAR = """
[rod.bar]
curve = {straight = 6.0}
section = {circle = 1.0}
law = {Plastic = {E = 200e3, nu = 0.3, hardening = [[0, 400], [0.1, 2000]], kinematic = 1e3}}
space = {elements = 2, section_degree = 3, degree = 3}

[support.wall]
end = "start"

[load.tip]
end = "end"
force = [0.0, 80.0, 1000.0]

[[step]]
time = 1.0
load.tip = 1.0

[[step]]
time = 1.0
load.tip = 0.2

[analysis.statics]
load_steps = 4

[measure.tip]
displacement = "bar"
component = "y"

[measure.moment]
moment = "wall"
component = "x"

[measure.stress]
stress = "bar"
component = "along"
u = 0.1
xi = [0.0, 0.9]
"""
LAW, RADIUS, LENGTH = "rod.bar.law.Plastic", "rod.bar.section.circle", "rod.bar.curve.straight"
FORCES = ("load.tip.force.1", "load.tip.force.2")
STRESSES = (f"{LAW}.E", f"{LAW}.hardening.0.1", f"{LAW}.hardening.1.1", f"{LAW}.kinematic")
PULLED = '[support.tip]\nend = "end"\ndisplacement = [0.0, 0.0, 0.06]\n'
FORCE = '[measure.force]\nreaction = "tip"\ncomponent = "z"\n'


def scene_of(path, text, law="", **words):
    """Return the scene of a text with another law, and other words, in a file."""
    old = text[text.index("law = ") : text.index("\n", text.index("law = "))]
    text = text.replace(old, f"law = {{{law}}}") if law else text
    for one, other in words.values():
        assert one in text
        text = text.replace(one, other)
    (path / "bar.toml").write_text(text)
    return files.find(str(path / "bar.toml"))


def solved(scene, made=None, comm=PETSc.COMM_SELF, values=None, **more):
    """Return a solution, of other values on the same discretisation where choices of it are known."""
    if made is None:
        model = scene.model()
    else:
        with choices.repeated(made):
            model = parameters.at(scene, values).model()
    return statics.solve(model, petsc=TIGHT, comm=comm, **scene.settings(), **more)


def begun(scene, comm=PETSc.COMM_SELF):
    """Return the choices of a scene, and its solution."""
    with choices.kept() as made:
        scene.model()
    return made, solved(scene, made, comm, {})


def runs_apart(scene, made, name, share):
    """Return the derivatives of what is measured as differences of two whole runs, and of what the first measures."""
    at = parameters.parameters(scene)[name]
    less, more = (scene.measure(solved(scene, made, values={name: at * (1.0 + s)})) for s in (-share, share))
    return {key: (more[key] - less[key]) / (2.0 * share * at) for key in more if key != "places"}


LAWS = {
    "kinematic and isotropic": ("", 1e-5),
    "recovery, whose tangent is not symmetric": (
        "Plastic = {E = 200e3, nu = 0.3, hardening = [[0, 300]], kinematic = 2e4, recovery = 30.0}",
        1e-5,
    ),
    "pressures as unknowns": ("Plastic = {E = 200e3, nu = 0.5, hardening = [[0, 300], [0.1, 2000]]}", 1e-5),
    "flow by time": (
        "Viscoplastic = {E = 200e3, nu = 0.3, hardening = [[0, 300], [0.1, 2000]], A = 0.1, n = 2.0}",
        1e-5,
    ),
    "relaxation": ("Viscoelastic = {E = 200e3, nu = 0.3, prony = [[0.5, 1.3]]}", 1e-4),
    "creep": ("Creep = {E = 200e3, nu = 0.3, A = 1e-10, n = 3.0}", 1e-4),
}


@pytest.mark.parametrize(("law", "share"), LAWS.values(), ids=LAWS)
def test_they_are_those_of_whole_runs_beside(tmp_path, law, share):
    """Constants, a length, and a load, up and down: of points that begin to yield there are none between these runs."""
    scene = scene_of(tmp_path, BAR, law)
    known = parameters.parameters(scene)
    constants = [one for one in known if one.endswith((".E", ".hardening.0.1", ".recovery", ".A", ".prony.0.1"))]
    names = [*constants, RADIUS, FORCES[0]]
    made, solution = begun(scene)
    found = derivatives.of(scene, solution, {name: known[name] for name in names}).checked()
    for name in names:
        for key, rate in runs_apart(scene, made, name, share).items():
            size = max(abs(rate), 1e-2 * abs(float(found.values[key]) / known[name]))
            assert abs(float(found.by[name][key]) - rate) < 1e-5 * size, (name, key)


def pulled():
    """Return the text of a bar that is pulled and let go in part: all of it flows, or none."""
    load = BAR[BAR.index("[load.tip]") : BAR.index("[[step]]")]
    return BAR[: BAR.index("[measure.tip]")].replace(load, PULLED).replace("load.tip", "support.tip") + FORCE


@pytest.mark.parametrize(
    ("text", "law", "name"),
    [
        (pulled(), "", STRESSES[1]),
        (pulled(), "", STRESSES[2]),
        (BAR, LAWS["creep"][0], RADIUS),
        (BAR, LAWS["creep"][0], FORCES[0]),
    ],
)
def test_the_remainder_of_taylor_is_of_second_order(tmp_path, text, law, name):
    scene = scene_of(tmp_path, text, law)
    made, solution = begun(scene)
    at, measured = parameters.parameters(scene)[name], next(iter(scene.units))
    found, rest = derivatives.of(scene, solution, {name: at}).checked(), []
    for share in (0.02, 0.01, 0.005):
        moved = scene.measure(solved(scene, made, values={name: at * (1.0 + share)}))[measured]
        rest.append(moved - float(found.values[measured]) - float(found.by[name][measured]) * at * share)
    np.testing.assert_allclose(np.log2(np.abs(rest[:-1]) / np.abs(rest[1:])), 2.0, atol=0.15)


def test_forces_scale_with_all_stresses_and_with_the_square_of_lengths(tmp_path):
    scene = scene_of(tmp_path, pulled())
    found = derivatives.of(scene, statics.solve(scene.model(), **scene.settings())).checked()
    assert sum(logarithmic(found, "force", one) for one in STRESSES) == pytest.approx(1.0, abs=3e-9)
    lengths = (LENGTH, RADIUS, "support.tip.displacement.2")
    assert sum(logarithmic(found, "force", one) for one in lengths) == pytest.approx(2.0, abs=3e-9)
    assert abs(logarithmic(found, "force", STRESSES[1])) > 0.3


def test_what_is_left_when_all_is_let_go_scales(tmp_path):
    """Supports carry nothing any more; the tip stays where stresses, over moduli and loads, are as they were."""
    scene = scene_of(tmp_path, BAR, last=("load.tip = 0.2", "unload = true"))
    found = derivatives.of(scene, statics.solve(scene.model(), **scene.settings())).checked()
    assert sum(logarithmic(found, "tip", one) for one in (*STRESSES, *FORCES)) == pytest.approx(0.0, abs=1e-7)
    assert abs(logarithmic(found, "tip", STRESSES[1])) > 3.0


def test_creep_goes_with_time_and_a_power_of_stress(tmp_path):
    """Strain rate A q^n: where all stresses grow s times and A falls by s^n, nothing changes."""
    scene = scene_of(tmp_path, BAR, LAWS["creep"][0])
    found = derivatives.of(scene, statics.solve(scene.model(), **scene.settings())).checked()
    law = "rod.bar.law.Creep"
    for measured, power in (("tip", 0.0), ("moment", 1.0)):
        stresses = sum(logarithmic(found, measured, one) for one in (f"{law}.E", *FORCES))
        assert stresses - 3.0 * logarithmic(found, measured, f"{law}.A") == pytest.approx(power, abs=1e-7)


@pytest.mark.parametrize("law", ["", "NeoHookean = {E = 200e3, nu = 0.3}"])
def test_curves_over_all_steps_have_them(tmp_path, law):
    """Forces at the end of each step, with a memory and without, scale with stresses."""
    scene = scene_of(tmp_path, pulled(), law)
    solution = solved(scene, keep=True)
    names = [one for one in parameters.parameters(scene) if one.endswith((".E", ".0.1", ".1.1", ".kinematic"))]

    def curve(one):
        return {"force": one.curves()["support 1 force z"][1:], "last": one.reactions[1, 2]}

    known = parameters.parameters(scene)
    found = solution.derivatives(
        lambda values: parameters.at(scene, values).model(), {name: known[name] for name in names}, curve
    ).checked()
    assert found.values["force"] == pytest.approx(curve(solution)["force"], rel=1e-8)
    whole = sum(found.by[name]["force"] * known[name] for name in names)
    np.testing.assert_allclose(whole, found.values["force"], atol=1e-8 * np.abs(found.values["force"]).max())
    assert len(whole) == solution.load_steps > 4
    for name in names:
        assert found.by[name]["force"][-1] == pytest.approx(found.by[name]["last"], rel=1e-12)


def test_pressures_that_follow_to_a_free_end_have_them(tmp_path):
    """The tangent is without what edges make of it that is not symmetric, derivatives are not."""
    steps = BAR[BAR.index("[[step]]") : BAR.index("[analysis")]
    pressure = "[load.gas]\npressure = 30.0\nfollows = true\n"
    words = {"steps": (steps, pressure), "few": ("load_steps = 4", "")}
    scene = scene_of(tmp_path, BAR, "NeoHookean = {E = 2e4, nu = 0.3}", **words)
    made, solution = begun(scene)
    names = {name: parameters.parameters(scene)[name] for name in ("rod.bar.law.NeoHookean.E", "load.gas.pressure")}
    found = derivatives.of(scene, solution, names).checked()
    for name in names:
        for key, rate in runs_apart(scene, made, name, 1e-4).items():
            assert float(found.by[name][key]) == pytest.approx(rate, rel=1e-5), (name, key)


def test_where_all_of_a_bar_begins_to_yield_there_is_none(tmp_path):
    """Its stress is the same everywhere, and that at which it yields."""
    text = METAL.replace("0.01]", f"{4.0 * (exp(400.0 / 200e3) - 1.0)!r}]")
    scene = scene_of(tmp_path, text)
    names = {STRESSES[1]: 400.0, f"{LAW}.hardening.1.0": 1.0, "support.right.displacement.2": 0.008}
    found = derivatives.of(scene, statics.solve(scene.model(), **scene.settings()), names)
    assert found.none[STRESSES[1]] == "the slope of force jumps, as where the largest of several changes its place"
    with pytest.raises(InputError, match="there is none here: the slope of force jumps"):
        found.checked()


def test_a_few_models_beside_at_a_time_find_the_same(tmp_path, monkeypatch):
    scene = scene_of(tmp_path, BAR)
    solution, names = solved(scene), {RADIUS: 1.0, FORCES[0]: 80.0, STRESSES[1]: 400.0}
    found = derivatives.of(scene, solution, names)
    monkeypatch.setattr(along_path, "_TOGETHER", 1)
    apart = derivatives.of(scene, solution, names)
    assert found.by == apart.by
    assert list(apart.by) == list(names)


def on_two(path):
    scene = files.find(path)
    both, alone = (
        derivatives.of(scene, solved(scene, comm=comm), dict.fromkeys([STRESSES[1]], 400.0) | {RADIUS: 1.0}).checked()
        for comm in (PETSc.COMM_WORLD, PETSc.COMM_SELF)
    )
    for name in alone.by:
        for measured in ("tip", "moment"):
            one, other = (logarithmic(each, measured, name) for each in (both, alone))
            assert one == pytest.approx(other, abs=1e-7)


def test_ranks_find_the_same(on_ranks, tmp_path):
    scene_of(tmp_path, BAR)
    on_ranks(2, f"test_rates_path.on_two({str(tmp_path / 'bar.toml')!r})")


def test_with_contact_and_a_memory_it_is_refused(tmp_path):
    text = RING.replace("NeoHookean = {E = 10.0, nu = 0.4}", "Plastic = {E = 10.0, nu = 0.3, hardening = [[0, 9.0]]}")
    (tmp_path / "ring.toml").write_text(text)
    with pytest.raises(InputError, match=r"^derivatives: not available with contact of laws with memory$"):
        refuse(files.find(str(tmp_path / "ring.toml")).model())
