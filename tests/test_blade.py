"""The blade of Lu & Zhou 2011, section 4.3: Table 2, Fig. 13, its section, the NACA sections, and its command line."""

import json
import re
from itertools import pairwise

import numpy as np
import pytest
from petsc4py import PETSc

from isorod import cli, modal, scenes
from isorod.disk import boundary_functions
from isorod.errors import InputError
from isorod.model import Model
from isorod.scenes.blade import Blade
from isorod.section import airfoil, naca

# Lu & Zhou, CMAME 200 (2011) 233-241, Table 2: the first ten frequencies [Hz] by number of elements.
TABLE_2 = {
    5: [0.19136, 0.95579, 1.44902, 2.49828, 3.46974, 5.30767, 5.63743, 9.64319, 10.4882, 10.7239],
    10: [0.18857, 0.79195, 1.43379, 2.06955, 2.46023, 4.20237, 5.09790, 5.53363, 7.63507, 8.16530],
    15: [0.18812, 0.77924, 1.43130, 1.96951, 2.45053, 3.76425, 5.06690, 5.51095, 6.24509, 8.06399],
    20: [0.18796, 0.77668, 1.43032, 1.95178, 2.44705, 3.69110, 5.05624, 5.50019, 6.02659, 8.03176],
    25: [0.187874, 0.775798, 1.42979, 1.94657, 2.44552, 3.67126, 5.05173, 5.49542, 5.97116, 8.01842],
    30: [0.187824, 0.775383, 1.42945, 1.94448, 2.44473, 3.66391, 5.04947, 5.49304, 5.9518, 8.01226],
}

# The same, appendix A: control points of the root section; the minus signs that print lost are put back.
SECTION = [
    [1.0, 0.0708625],
    [0.847759, 0.177017],
    [0.566454, 0.227835],
    [0.198912, 0.225],
    [-0.198912, 0.18125],
    [-0.566454, 0.116567],
    [-0.847759, 0.0531051],
    [-1.0, 0.00994562],
    [-1.0, 0.00397825],
    [-0.847759, 0.00566454],
    [-0.566454, 0.0],
    [-0.198912, -0.01],
    [0.198912, -0.02],
    [0.566454, -0.0254328],
    [0.847759, -0.0226582],
    [1.0, -0.00994562],
]

# dolfinx, curved Q3 bricks, 218,163 unknowns, of the same blade: the 3-D solution, from above (the clamped edge is singular).
SOLID = [0.18273, 0.75338, 1.37162, 1.87838, 2.10765, 3.51257, 4.35226, 5.26998, 5.6413, 6.88]


@pytest.fixture(scope="module")
def frequencies():
    """Frequencies of the paper's blade by number of elements, each computed once."""
    found = {}

    def get(elements):
        if elements not in found:
            found[elements] = modal.solve(Blade(elements=elements, quadrature="paper").model()).frequencies
        return found[elements]

    return get


@pytest.mark.parametrize("elements", TABLE_2)
def test_frequencies_of_table_2(elements, frequencies):
    """All ten; 0.3 % is what three unpublished numbers (length, twist, taper), fitted, leave."""
    deviations = frequencies(elements) / TABLE_2[elements] - 1.0
    print("deviations", *(f"{100 * deviation:.3f} %" for deviation in deviations))
    assert deviations.shape == (10,)
    assert np.abs(deviations).max() < 0.003


def slopes(frequency):
    """Slopes of log(f / f_30 - 1) over log(N), N = 5 ... 25, of the first three modes: the lines of Fig. 13."""
    count = np.array([5, 10, 15, 20, 25])
    errors = np.array([np.array(frequency(n))[:3] for n in count]) / np.array(frequency(30))[:3] - 1.0
    assert errors.min() > 0
    return -np.polyfit(np.log(count), np.log(errors), 1)[0]


def test_order_of_figure_13(frequencies):
    """One order for the three lines; each for itself has the slope that the printed frequencies give (2.55, 3.71, 2.42)."""
    found = slopes(frequencies)
    print("orders", found, "mean", found.mean())
    assert 2.7 < found.mean() < 3.5
    assert np.abs(found - slopes(lambda n: TABLE_2[n])).max() < 0.02


def test_section_has_the_control_points_printed():
    """To half a unit of the last of six printed digits."""
    assert np.abs(airfoil() - SECTION).max() < 1e-6


def test_rod_is_swept_with_twist_and_taper():
    points = Blade(length=5.0, twist=30.0, taper=0.4, chord=3.0).rod().control_points
    assert points.shape == (3, 16, 3)
    assert np.array_equal(points[:, :, 2], [[0.0] * 16, [2.5] * 16, [5.0] * 16])
    for layer, angle, size in zip(points, np.radians([0.0, 15.0, 30.0]), [1.5, 1.5 * 0.7, 1.5 * 0.4], strict=True):
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        assert np.abs(layer[:, :2] - size * np.array(SECTION) @ turn).max() < 2e-6


def naca_points(digits, theta, chord=1.0):
    """Points of the airfoil of Jacobs, Ward, Pinkerton (NACA Report 460, 1933) at x = (1 + cos theta) / 2, one by one."""
    m, p, t = int(digits[0]) / 100, int(digits[1]) / 10, int(digits[2:]) / 100
    points = []
    for angle in theta:
        x = (1 + np.cos(angle)) / 2
        half = t / 0.2 * (0.2969 * x**0.5 - 0.1260 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1015 * x**4)
        mean = slope = 0.0
        if m and x < p:
            mean, slope = m / p**2 * (2 * p * x - x**2), 2 * m / p**2 * (p - x)
        elif m:
            mean, slope = m / (1 - p) ** 2 * (1 - 2 * p + 2 * p * x - x**2), 2 * m / (1 - p) ** 2 * (p - x)
        side = 1 if np.sin(angle) > 0 else -1
        tilt = np.arctan(slope)
        points.append((x - side * half * np.sin(tilt) - 0.5, mean + side * half * np.cos(tilt)))
    return chord * np.array(points)


THETA = 2 * np.pi * (np.arange(2000) + 0.5) / 2000
FOILS = ["0012", "2412", "4415", "0006", "6409"]


@pytest.mark.parametrize("digits", FOILS)
def test_naca_outline_converges_to_the_formula(digits):
    """Away from the blunt trailing edge, whose step of 0.21 % of the thickness ratio a smooth outline rounds off."""
    exact = naca_points(digits, THETA)
    fore = exact[:, 0] < 0.35
    errors = []
    for n in (8, 16, 32, 64):
        distance = np.linalg.norm(boundary_functions(n, THETA) @ naca(digits, n) - exact, axis=1)
        errors.append(distance[fore].max())
        step = 2 * 0.0105 * int(digits[2:]) / 100
        assert distance.max() < step + errors[-1]
    print("errors", errors)
    assert errors[1] < 0.006 * int(digits[2:]) / 100 + 0.02 * int(digits[0]) / 100
    assert all(b < 0.6 * a for a, b in pairwise(errors))


@pytest.mark.parametrize(("digits", "n"), [(digits, n) for digits in FOILS for n in (16, 32)])
def test_naca_thickness_and_camber(digits, n):
    """Largest thickness and camber of the fitted outline, measured between its upper and lower side."""
    x, y = (boundary_functions(n, THETA) @ naca(digits, n)).T
    stations = np.linspace(-0.45, 0.35, 401)
    upper = np.interp(stations, x[:1000][::-1], y[:1000][::-1])
    lower = np.interp(stations, x[1000:], y[1000:])
    camber, thickness = int(digits[0]) / 100, int(digits[2:]) / 100
    # The thickness stands at right angles to the camber line, which tilts it by up to 4 camber / chord.
    assert (upper - lower).max() == pytest.approx(thickness, abs=0.003 * thickness + 8 * camber**2 * thickness)
    assert (upper + lower).max() / 2 == pytest.approx(camber, abs=0.0005 + 8 * camber * thickness**2)
    assert np.ptp(x) == pytest.approx(1.0, abs=1e-3)


def test_naca_section_lies_as_the_paper_draws_it():
    """Counter-clockwise, in proportion to the chord, the sharp end towards +x; without camber symmetric."""
    points = naca("2415", 24)
    following = np.roll(points, -1, axis=0)
    assert np.sum(points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0]) > 0
    assert np.abs(naca("2415", 24, 3.5) - 3.5 * points).max() < 1e-14
    x, y = (boundary_functions(24, THETA) @ points).T
    blunt, sharp = (np.ptp(y[near]) for near in (np.abs(x + 0.45) < 0.02, np.abs(x - 0.45) < 0.02))
    assert blunt > 2 * sharp
    symmetric = naca("0015", 24)
    assert np.abs(np.roll(symmetric[::-1], 1, axis=0) * [1.0, -1.0] - symmetric).max() < 1e-13


BAD_DIGITS = ["", "12", "241", "24123", "24x2", "-412", "+412", "2 12", "24.2", "2400", "0000", "0412", "2012", "NACA"]


@pytest.mark.parametrize("digits", [*BAD_DIGITS, "241\N{SUPERSCRIPT TWO}", "\N{ARABIC-INDIC DIGIT TWO}412"])
def test_naca_refuses_what_is_no_four_digit_number(digits):
    with pytest.raises(InputError, match="need a NACA 4-digit number such as 2412") as caught:
        naca(digits, 16)
    assert repr(digits) in str(caught.value)


@pytest.mark.parametrize("chord", [0.0, -1.0, np.nan, np.inf])
def test_chord_must_be_a_length(chord):
    for make in (lambda: naca("2412", 16, chord), lambda: Blade(chord=chord).rod()):
        with pytest.raises(InputError, match=f"chord: got {chord:g}, need a positive length"):
            make()


@pytest.mark.parametrize("digits", ["0012", "2412", "4415", "0006"])
def test_a_blade_of_naca_section_does_not_fold(digits):
    assert Blade(airfoil=digits).rod().check() > 0


CHANGES = {
    "Young's modulus": ({"E": 1.2e7}, 2.0),
    "density": ({"density": 160.0}, 0.5),
    "size": ({"length": 16.6, "chord": 4.0}, 0.5),
    "all": ({"E": 3.0e6 / 16, "density": 10.0, "length": 8.3 / 1024, "chord": 2.0 / 1024}, 512.0),
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("foil", ["paper", "2412"])
def test_frequencies_scale_with_wave_speed_over_length(change, foil):
    values, factor = CHANGES[change]
    one, other = (modal.solve(Blade(elements=6, airfoil=foil, **more).model()).frequencies for more in ({}, values))
    assert np.abs(other / one / factor - 1.0).max() < 1e-9


def test_opposite_twists_of_a_symmetric_foil_sound_the_same():
    one, other, flat = (
        modal.solve(Blade(elements=6, airfoil="0012", twist=twist).model()).frequencies for twist in (25, -25, 0)
    )
    assert np.abs(one / other - 1.0).max() < 1e-8
    assert np.abs(one / flat - 1.0).max() > 0.01


def test_refined_spaces_nest_and_their_frequencies_fall():
    """Rayleigh-Ritz, with a rule that integrates the products of the functions (nearly) exactly; never below the solid."""
    steps = [
        {"elements": 5},
        {"elements": 10},
        {"elements": 20},
        {"elements": 20, "degree": 3, "continuity": 1},
        {"elements": 20, "degree": 3, "continuity": 1, "order": 2},
    ]
    found = [modal.solve(Blade(quadrature="8x4", **step).model()).frequencies for step in steps]
    for coarse, fine in pairwise(found):
        assert np.all(fine < coarse)
    assert np.all(found[-1] > SOLID)
    assert np.abs(found[-1] / SOLID - 1.0).max() < 0.02


@pytest.mark.slow
def test_order_3_on_a_fine_section_is_the_solid():
    """0.3 % of dolfinx; the clamped edge is singular, so that both come from above and slowly."""
    blade = Blade(elements=16, section_points=32, order=3, degree=3, quadrature="full")
    assert np.abs(modal.solve(blade.model()).frequencies / SOLID - 1.0).max() < 0.003


def shapes(model, vectors):
    """Return displacements of modes on a grid of points, one row a mode."""
    space = model.bodies[0].space
    xi = np.array([[0.0, 0.0], [0.8, 0.0], [-0.8, 0.0], [0.0, 0.8], [0.0, -0.8]])
    u = np.linspace(0.0, 1.0, 21)
    return np.array([space.displacement(model.nodal(vector), xi, u)[0].ravel() for vector in vectors])


def mac(a, b):
    """Return the modal assurance criterion of the rows of two arrays."""
    return (a @ b.T) ** 2 / np.outer((a * a).sum(axis=1), (b * b).sum(axis=1))


@pytest.mark.parametrize("finer", [{"elements": 40}, {"elements": 15, "degree": 3}, {"elements": 10, "degree": 4}])
def test_mode_shapes_converge(finer):
    found = [modal.solve(Blade(**fields, quadrature="paper").model()) for fields in ({"elements": 20}, finer)]
    table = mac(*(shapes(modes.model, modes.vectors) for modes in found))
    print(np.diag(table))
    assert np.diag(table).min() > 0.998
    assert np.array_equal(table.argmax(axis=0), np.arange(10))


def test_free_blade_has_six_rigid_modes_and_higher_frequencies():
    model = Blade(elements=8).model()
    free, held = modal.solve(Model(model.bodies)), modal.solve(model)
    assert (free.rigid, held.rigid) == (6, 0)
    assert np.all(free.frequencies[:6] < 1e-4 * free.frequencies[6])
    # A constraint lifts every eigenvalue.
    assert np.all(free.eigenvalues[:10] < held.eigenvalues)


ISSUE = "--section-points 16 --elements 30 --modes 10 --quadrature paper --json".split()


def test_record_of_the_blade(capsys):
    assert cli.main(["run", "blade", *ISSUE]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    record = json.loads(out)
    assert np.abs(np.array(record["frequencies"]) / TABLE_2[30] - 1.0).max() < 0.003
    assert (record["dofs"], record["unknowns"]) == (32 * 16 * 3, 31 * 16 * 3)
    assert len(record["residuals"]) == 10
    assert max(record["residuals"]) < 1e-7
    assert record["quadrature"] == ["2x1x3"]
    assert record["built"] == ["tangent", "mass"]
    assert {"setup", "assembly", "solve", "total"} <= set(record["seconds"])
    assert (record["rigid"], record["below"]) == (0, 10)


ALONE = """
import json, sys
from isorod import cli, material

def refuse(*_):
    raise AssertionError("a nonlinear law was evaluated")

for name in dir(material.NeoHookean):
    if not name.startswith("_") and callable(getattr(material.NeoHookean, name)):
        setattr(material.NeoHookean, name, refuse)
material.NeoHookean.__init__ = refuse
material.LinearElastic.stress = refuse
assert cli.main(["run", "blade", "--elements", "5", "--json"]) == 0
print(json.dumps(sorted({name.split(".")[0] for name in sys.modules})))
"""


def test_blade_evaluates_no_nonlinear_law_and_loads_no_other_solver(python):
    done = python(ALONE)
    assert done.returncode == 0, done.stderr
    record, loaded = (json.loads(line) for line in done.stdout.splitlines())
    assert record["built"] == ["tangent", "mass"]
    assert not set(loaded) & {"dolfinx", "ufl", "basix", "gmsh", "pyvista", "vtkmodules", "matplotlib"}


@pytest.fixture
def blade(capsys):
    """Run the blade in this process; PETSc started long ago, so that its options are put where it keeps them."""
    typed = []

    def run(*arguments):
        theirs = [word for word in arguments if re.match(r"-[a-z]", word)]
        typed.extend(word[1:] for word in theirs)
        k = min((arguments.index(word) for word in theirs), default=len(arguments))
        PETSc.Options().insertString(" ".join(arguments[k:]))
        code = cli.main(["run", "blade", *arguments])
        return (code, *capsys.readouterr())

    yield run
    for name in typed:
        PETSc.Options().delValue(name)


@pytest.fixture
def refused(blade, tmp_path):
    """Return the one line of complaint, having made sure that it is the only effect."""

    def run(*arguments):
        code, out, err = blade("--elements", "6", "--output", str(tmp_path / "results"), *arguments)
        assert (code, out) == (2, "")
        assert re.fullmatch(r"isorod: .+\n", err), err
        assert not any(tmp_path.iterdir())
        return err

    return run


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--density 0", "density of body 0: got 0, modes need a positive mass per volume"),
        ("--density -40", "density: got -40, need a finite mass per volume, not negative"),
        ("--density nan", "density: got nan, need a finite mass"),
        ("--density inf", "density: got inf, need a finite mass"),
        ("--E 0", "E: got 0, need a positive stress"),
        ("--nu 0.5", "incompressible .nu = 0.5.; that takes formulation .mixed."),
        ("--length 0", "length: got 0, need a positive"),
        ("--length nan", "length: got nan, need a positive"),
        ("--taper 0", "taper: got 0, need a positive"),
        ("--taper -0.5", "taper: got -0.5, need a positive"),
        ("--twist nan", "twist: got nan degrees"),
        ("--twist 360", "twist: got 360 degrees, the one element of the blade carries -90 to 90"),
        ("--twist -91", "twist: got -91 degrees"),
        ("--chord 0 --airfoil 2412", "chord: got 0, need a positive length"),
        (
            "--chord 1e-8",
            r"body 0 is free to turn about \(.*\), as far as 1e-8 of its size tells.*hold it, or give a shift",
        ),
        ("--airfoil 24", "airfoil: got '24', need a NACA 4-digit number such as 2412"),
        ("--airfoil 2400", "airfoil: got '2400'"),
        ("--airfoil clarky", "airfoil: got 'clarky'"),
        ("--airfoil 241\N{SUPERSCRIPT TWO}", "airfoil: got '241.', need a NACA"),
        ("--section-points 8", "got 8, need a multiple of the 16"),
        ("--airfoil 2412 --section-points 2", "section control points: got 2"),
        ("--order 0", "order.* got 0"),
        ("--degree 1", "axis degree: got 1, need an integer from 2 to 6"),
        ("--elements 0", "elements: got 0"),
        ("--section-degree 0", "section degree: got 0, need an integer from 1 to 8"),
        ("--section-degree 9", "section degree: got 9"),
        ("--section-degree 2.5", "--section-degree: invalid int value"),
        ("--section-degree 3 --order 2", "polynomials take the place of order and section points"),
        ("--section-degree 3 --section-points 32", "polynomials take the place of order and section points"),
        ("--quadrature best", "quadrature: got 'best'"),
        ("--modes 0", r"modes: got 0, need 1 to 336 \(the unknowns there are\)"),
        ("--modes -3", "modes: got -3, need 1 to 336"),
        ("--modes 337", "modes: got 337, need 1 to 336"),
        ("--modes nan", "--modes: invalid int value: 'nan'"),
        ("-eps_nev 0", "modes: got 0, need 1 to 336"),
        ("-eps_nev 337", "modes: got 337, need 1 to 336"),
        ("-eps_nev four", "four has no integer value"),
        ("--mass heavy", "--mass: invalid choice: 'heavy'"),
        ("--load-steps 2", "option --load-steps is not known"),
        ("-eps_max_it 1 -eps_ncv 13", r"SLEPc found \d of 10 in 1 iterations .*raise -eps_max_it"),
        ("-eps_ncv 5", "value of ncv must be at least nev"),
        ("-st_type shift", r"SLEPc found \d of 10 in \d+ iterations"),
        ("-st_shift 1e6", r"SLEPc found \d+ of 10 in|were found"),
        ("-eps_largest_real", "requires a target"),
        ("-eps_type nonsense", "Unknown EPS type given: nonsense"),
        ("-eps_typo 3", "option -eps_typo 3: nothing used it"),
        ("-snes_monitor", "option -snes_monitor: nothing used it"),
    ],
)
def test_bad_input_is_one_line(arguments, message, refused):
    assert re.search(message, refused(*arguments.split()))


@pytest.mark.parametrize("mode", [0, 1, 4])
def test_a_shift_at_an_eigenvalue_is_one_line_or_right(mode, blade, refused):
    """K - shift M is singular: its own direction blows up and no other, unless vectors are purified with it."""
    expected = modal.solve(Blade(elements=6).model())
    shift = ("-st_shift", repr(float(expected.eigenvalues[mode])))
    code, out, _ = blade("--elements", "6", "--json", *shift)
    assert code == 0
    assert json.loads(out)["frequencies"] == pytest.approx(expected.frequencies, rel=1e-7)
    message = refused(*shift, "-eps_purify", "1")
    assert re.search(r"modes: the residual of mode \d+ is .*the shift lies on an eigenvalue.*-st_shift", message)


@pytest.mark.parametrize(
    "options",
    [
        "-eps_nev 4",
        "-eps_type arnoldi",
        "-eps_type subspace",
        "-eps_type lapack",
        "-eps_type lobpcg",
        "-eps_type gd",
        "-eps_type rqcg",
        "-eps_tol 1e-6",
        "-eps_ncv 60",
        "-st_pc_type lu",
        "-st_pc_type cholesky -st_pc_factor_mat_solver_type petsc",
        "-st_pc_factor_mat_solver_type mumps",
        "-st_ksp_type gmres -st_ksp_rtol 1e-12",
        "-st_shift -1",
        "-st_shift 100",
        "-eps_target 5",
        "-eps_lanczos_reorthog full -eps_type lanczos",
    ],
)
def test_options_of_slepc_reach_it_and_change_no_frequency(options, blade):
    """To 1e-6, since some of them only take a looser tolerance."""
    expected = modal.solve(Blade(elements=8).model(), 4)
    code, out, err = blade("--elements", "8", "--modes", "4", "--json", *options.split())
    assert (code, err) == (0, "")
    record = json.loads(out)
    assert np.abs(np.array(record["frequencies"]) / expected.frequencies - 1.0).max() < 1e-6
    assert max(record["residuals"]) < 1e-5
    typed = dict(re.findall(r"-(\w+_type) (\w+)", options))
    assert record["solver"]["eps"] == typed.get("eps_type", "krylovschur")
    assert record["solver"]["ksp"] == typed.get("st_ksp_type", record["solver"]["ksp"])
    assert record["solver"]["pc"] == typed.get("st_pc_type", record["solver"]["pc"])


def test_slepc_options_in_a_fresh_process(isorod):
    """The number of modes typed for SLEPc wins; its monitors write beside the record."""
    typed = "-eps_nev 3 -eps_type arnoldi -st_pc_factor_mat_solver_type mumps -eps_monitor -eps_view"
    done = isorod("run", "blade", "--elements", "6", "--modes", "9", "--json", *typed.split())
    assert (done.returncode, done.stderr) == (0, "")
    *lines, last = done.stdout.splitlines()
    assert any(re.search(r"EPS nconv=\d+", line) for line in lines)
    assert "  type: arnoldi" in lines
    assert len(json.loads(last)["frequencies"]) == 3


@pytest.mark.parametrize("typed", ["-eps_max_it 1 -eps_ncv 13", "-eps_typo 3", "-eps_nev 400"])
def test_errors_of_a_fresh_process_are_one_line(typed, isorod):
    done = isorod("run", "blade", "--elements", "6", "--json", *typed.split())
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(
        r"isorod: (modes: SLEPc found \d|PETSc option -eps_typo 3|modes: got 400, need).+\n", done.stderr
    )


def test_lumped_mass_from_the_command_line(capsys):
    assert cli.main("run blade --elements 6 --json --mass lumped".split()) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["built"] == ["tangent", "lumped mass"]
    assert record["settings"]["lumped"] is True
    assert record["frequencies"] == pytest.approx(modal.solve(Blade(elements=6).model(), lumped=True).frequencies)


def test_modes_are_written_for_pictures(tmp_path, capsys):
    pyvista = pytest.importorskip("pyvista")
    assert cli.main(["run", "blade", "--elements", "6", "--modes", "3", "--output", str(tmp_path)]) == 0
    mesh = pyvista.read(tmp_path / "blade-0.vtu")
    assert {"mode_1", "mode_2", "mode_3"} <= set(mesh.array_names)
    root = np.abs(mesh.points[:, 2]) < 1e-9
    assert root.any()
    assert not np.abs(mesh["mode_1"][root]).max()


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_eigenvalues_do_not_depend_on_the_number_of_ranks(ranks, frequencies, mpirun):
    done = mpirun(ranks, "run", "blade", *ISSUE)
    assert (done.returncode, done.stderr) == (0, "")
    record = json.loads(done.stdout)
    assert record["ranks"] == ranks
    assert record["below"] == 10
    found = np.array(record["frequencies"]) ** 2
    assert np.abs(found / frequencies(30) ** 2 - 1.0).max() < 1e-9
    assert max(record["residuals"]) < 1e-7


def test_blade_is_in_the_list_of_scenes():
    assert scenes.find("blade") is Blade
