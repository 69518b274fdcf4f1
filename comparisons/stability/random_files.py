"""Results of `isorod run` of random scene files, by default, against much finer spaces.

``python -m comparisons.stability.random_files 100`` draws seeds 0 to 99, ``100 200`` those from 100 on; ``100 200 60``
leaves out those that take more than a minute with what they are compared with.  ``coarse`` after these takes random
spaces, most of them coarser than those that are chosen.  Drawn are curves, sections, tapers and
twists, holes and layers, laws, supports, loads, rotations, spin and contact; statics, and modes at rest and about what
is loaded.  It prints a line a file, and a table in the end.  Compared are what the estimate is of (works, forces and
moments of supports, frequencies), the answers (reactions, moments and displacements, or frequencies) and stresses at
20 places farther from ends than the section is wide.  A file is silent if an answer is off by more than half a
percent, or a stress by more than three, without an estimate or a warning of that.
"""

import signal
import sys
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any, cast

import numpy as np

from comparisons.stability import estimates
from isorod import options
from isorod.arrays import Array
from isorod.checks import stresses
from isorod.command import solving
from isorod.errors import InputError, SolveError
from isorod.files.scene import FileScene
from isorod.geometry.quadrature import WHOLE
from isorod.output import results
from isorod.space import Space, choice

# Of all but pressing: what happens, and how often.
STATICS = ("force", "moved", "rotated", "force and moved", "pressure", "weight", "spin", "pressed")
MODES = ("modes", "modes, pulled", "modes, spun", "modes, rotated")
CHANCES = (0.14, 0.1, 0.14, 0.08, 0.08, 0.06, 0.06, 0.06, 0.12, 0.06, 0.05, 0.05)

# Points of a rod at which displacements are compared.
_ALONG, _ACROSS = (0.17, 0.5, 0.83, 1.0), ((0.9, 0.0), (-1.0, 0.0), (0.0, 1.0))

# Spaces of fewer functions take twice the elements: others would take minutes.
_FEW = 1200

# Results below this fraction of the largest of their kind are not compared.
_NOTHING = 1e-6


def draw(seed: int) -> tuple[str, str]:
    """Return the kind of a random load case, and its scene file."""
    rng = np.random.default_rng([seed, 31])
    kind = str(rng.choice(STATICS + MODES, p=CHANCES))
    radius = 10.0 ** rng.uniform(-1.0, 1.0)
    curve, length, straight = _curve(rng, radius, kind == "pressed")
    section, thin = _section(rng, radius, kind == "pressed")
    lines = ["[rod.rod]", f"curve = {curve}", f"section = {section}", "density = 2.0"]
    if rng.random() < 0.25 and kind != "pressed":
        # One number for each point of a polyline.
        taper = np.linspace(1.0, rng.uniform(0.5, 1.0), 9 if "points" in curve else 2)
        lines.append(f"scale = {_numbers(taper)}")
    if rng.random() < 0.25 and kind != "pressed":
        lines.append(f"twist = {rng.uniform(-60.0, 60.0):.3g}")
    walls = rng.choice(3, p=(0.8, 0.1, 0.1)) if kind != "pressed" else 0
    if walls:
        inner = rng.uniform(0.3, 0.8)
        lines.append(f"rings = [{inner:.3g}, 1.0]" if walls == 1 else f"rings = [0.0, {inner:.3g}, 1.0]")
    modulus = 10.0 ** rng.uniform(0.0, 5.0)
    loaded = kind.startswith("modes,")
    laws = [_law(rng, modulus, loaded)]
    if walls == 2:
        laws.append(_law(rng, modulus * 10.0 ** rng.uniform(-1.5, 0.0), loaded))
    lines.append(f"law = [{', '.join(laws)}]" if walls == 2 else f"law = {laws[0]}")
    bending = modulus * radius * (thin * radius) ** 3 / length**2
    lines += _burden(rng, kind, radius, thin * radius, length, modulus, bending, straight)
    lines.append("analysis = {modal = {modes = 4}}" if kind.startswith("modes") else "[analysis.statics]")
    # Keys of no table come first.
    first = [line for line in lines if line.startswith("analysis =")]
    return kind, "\n".join(first + [line for line in lines if line not in first]) + "\n"


def _numbers(values: Sequence[float] | Array) -> str:
    return "[" + ", ".join(f"{one:.6g}" for one in values) + "]"


def _curve(rng: np.random.Generator, radius: float, pressed: bool) -> tuple[str, float, bool]:
    """Return a curve, its length, and whether it is straight."""
    kind = "straight" if pressed else rng.choice(["straight", "arc", "helix", "polyline"], p=(0.5, 0.2, 0.15, 0.15))
    if kind == "straight":
        length = radius * 10.0 ** (rng.uniform(0.7, 1.5) if pressed else rng.uniform(0.7, 2.3))
        return f"{{straight = {length:.6g}}}", length, True
    if kind == "arc":
        around, angle = radius * rng.uniform(4.0, 20.0), rng.uniform(20.0, 180.0)
        return f"{{arc = {around:.6g}, angle = {angle:.4g}}}", around * np.radians(angle), False
    if kind == "helix":
        around, pitch, turns = radius * rng.uniform(3.0, 10.0), radius * rng.uniform(3.0, 8.0), rng.uniform(0.3, 3.0)
        text = f"{{helix = {{radius = {around:.6g}, pitch = {pitch:.6g}, turns = {turns:.4g}}}}}"
        return text, float(turns * np.hypot(2.0 * np.pi * around, pitch)), False
    t = np.linspace(0.0, 1.0, 9)[:, None] * rng.uniform(0.5, 1.5, size=3)
    points = 20.0 * radius * np.stack([np.sin(t[:, 0]), t[:, 1] ** 2, t[:, 2]], axis=1)
    text = ", ".join(map(_numbers, points))
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return f"{{polyline = {{points = [{text}], tolerance = {0.05 * radius:.3g}}}}}", length, False


def _section(rng: np.random.Generator, radius: float, pressed: bool) -> tuple[str, float]:
    """Return a section, and its thickness over its width."""
    kind = (
        rng.choice(["circle", "ellipse"])
        if pressed
        else rng.choice(["circle", "ellipse", "rounded_rectangle", "naca"], p=(0.45, 0.3, 0.15, 0.1))
    )
    if kind == "circle":
        return f"{{circle = {radius:.6g}}}", 1.0
    thin = float(rng.uniform(0.25, 1.0))
    if kind == "ellipse":
        return f"{{ellipse = {{a = {radius:.6g}, b = {thin * radius:.6g}}}}}", thin
    if kind == "rounded_rectangle":
        size = (
            f"width = {2.0 * radius:.6g}, height = {2.0 * thin * radius:.6g}, corner_radius = {0.4 * thin * radius:.6g}"
        )
        return f"{{rounded_rectangle = {{{size}}}}}", thin
    return f'{{naca = {{digits = "2415", chord = {2.0 * radius:.6g}}}}}', 0.15


def _law(rng: np.random.Generator, modulus: float, loaded: bool) -> str:
    """Return a law; where modes are about a load one that knows stresses."""
    names = ["NeoHookean", "LinearElastic", "StVenantKirchhoff", "MooneyRivlin", "Hgo", "Kirchhoff", "Transverse"]
    chances = np.array((0.35, 0.2, 0.1, 0.1, 0.1, 0.1, 0.05))
    if loaded:
        chances[[1, 6]] = 0.0
    name = rng.choice(names, p=chances / chances.sum())
    nu = float(rng.choice([0.0, 0.3, 0.45, 0.49, 0.499]))
    stiff = modulus * 10.0 ** rng.uniform(0.3, 1.3)
    if name == "MooneyRivlin":
        bulk = "inf" if rng.random() < 0.5 else f"{5.0 * modulus:.4g}"
        return f"{{MooneyRivlin = {{c10 = {modulus / 8:.5g}, c01 = {modulus / 24:.5g}, bulk = {bulk}}}}}"
    if name == "Hgo":
        constants = f"c = {modulus / 6:.5g}, k1 = {0.3 * stiff:.5g}, k2 = 1.0, bulk = {5.0 * modulus:.5g}"
        return f"{{HolzapfelGasserOgden = {{{constants}}}}}"
    if name == "Kirchhoff":
        constants = (
            f"E = {_numbers([stiff, modulus, modulus])}, nu = [0.3, 0.3, 0.3], G = {_numbers([0.4 * modulus] * 3)}"
        )
        return f"{{OrthotropicKirchhoff = {{{constants}}}}}"
    if name == "Transverse":
        constants = f"E = {stiff:.5g}, E_across = {modulus:.5g}, nu = 0.3, nu_across = 0.3, G = {0.4 * modulus:.5g}"
        return f"{{TransverselyIsotropic = {{{constants}}}}}"
    return f"{{{name} = {{E = {modulus:.5g}, nu = {nu:g}}}}}"


def _burden(
    rng: np.random.Generator,
    kind: str,
    radius: float,
    height: float,
    length: float,
    modulus: float,
    bending: float,
    straight: bool,
) -> list[str]:
    """Return the lines of supports, loads, spin and contact."""
    size = 10.0 ** rng.uniform(-3.0, -0.5)
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    if straight:
        # Nothing that pushes it past buckling.
        direction[2] = abs(direction[2])
    support = ["[support.start]", 'end = "start"']
    force = ["[load.force]", 'end = "end"', f"force = {_numbers(size * bending * direction)}"]
    end = ["[support.end]", 'end = "end"']
    moved = f"displacement = {_numbers(min(size, 0.1) * min(3.0 * radius, 0.2 * length) * direction)}"
    if kind in ("force", "modes"):
        return support + (force if kind == "force" else end * (rng.random() < 0.4))
    if kind == "moved":
        return [*support, *end, moved]
    if kind in ("rotated", "modes, rotated"):
        # Along a straight rod as far as it likes, short of a loop; else by less.
        angle = 10.0 ** rng.uniform(0.0, 2.5 if straight else 1.5)
        axis = np.array([0.0, 0.0, 1.0]) if straight and rng.random() < 0.6 else direction
        angle = angle if axis[2] == 1.0 else min(angle, 60.0)
        angle = min(angle, 5.0 * length / radius) * (1.0 if kind == "rotated" else 0.3)
        return [*support, *end, f"rotation = {_numbers(angle * axis)}"]
    if kind == "force and moved":
        middle = ["[load.force]", "section = 0.5", f"force = {_numbers(2.0 * size * bending * direction)}"]
        return support + [*end, moved] + (middle if straight else force[:0])
    if kind == "pressure":
        return [*support, "[load.pressure]", f"pressure = {size * 0.1 * modulus:.5g}"]
    if kind == "weight":
        return [
            *support,
            "[load.weight]",
            f"body_force = {_numbers(size * bending / (3.0 * radius**2 * length) * direction)}",
        ]
    if kind in ("spin", "modes, spun"):
        # Up to the lowest frequency of a cantilever about.
        speed = 3.0 * np.sqrt(modulus / 2.0) * 0.5 * radius / length**2 * rng.uniform(0.1, 1.0)
        return [*support, "[spin]", f"velocity = {_numbers(speed * direction)}"]
    if kind == "pressed":
        # Bent over a cylinder across it, in the middle.
        around = radius * rng.uniform(1.0, 5.0)
        place = (
            f"point = [0.0, {-height - around:.6g}, {0.5 * length:.6g}], axis = [1.0, 0.0, 0.0], radius = {around:.6g}"
        )
        support += ["[obstacle.drum]", f"Cylinder = {{{place}}}"]
        support += ["[contact.drum]", 'first = "rod"', 'second = "drum"', f"penalty = {30.0 * modulus / radius:.5g}"]
        return [*support, *end, f"displacement = [0.0, {-min(size, 0.1) * min(3.0 * radius, 0.2 * length):.6g}, 0.0]"]
    # A string.
    pull = modulus * radius**2 * 10.0 ** rng.uniform(-4.0, -1.5)
    return [*support, *end, 'components = "xy"', "[load.pull]", 'end = "end"', f"force = [0.0, 0.0, {pull:.5g}]"]


def finer(space: Space, level: int) -> Space:
    """Return a space of degree 6 along the axis, of more functions across, and on level 2 of shorter elements too."""
    along: dict[str, Any] = {"elements": space.elements, "knots": space.knots or ()}
    if space.section_degree is None or (level == 2 and space.axis.count * space.basis.count < _FEW):
        along = choice.halved(space)
    along |= {"degree": 6, "continuity": min(cast(int, space.continuity), 2)}
    if space.section_degree is None:
        across: dict[str, Any] = {"order": space.order, "section_points": (1 + level) * space.points_around}
    else:
        whole = space.rod.rings == WHOLE
        across = {"section_degree": min(space.section_degree + level + whole, 8 if whole else 10)}
    space = Space(space.rod, **along, **across)
    return replace(space, quadrature=str(choice.rule(space)))


def _works(solution: Any) -> Array:
    """Return the estimated quantities: works of supports and loads, or frequencies."""
    if not hasattr(solution, "reactions"):
        return cast(Array, solution.frequencies)
    model, works = solution.model, [float(solution.work)]
    for load in model.loads:
        nodal = getattr(load, "nodal", None)
        if nodal is not None and not getattr(load, "follows", False):
            works.append(float(nodal(model.bodies[0].space).ravel() @ solution.displacement))
    # Of a spin, and of what follows, in proportion to it.
    return np.array(works if np.any(works) else [solution.energy(0)])


def _answers(solution: Any) -> list[tuple[Array, float]]:
    """Return the quantities of interest, each kind by itself, and the size to which its error is relative."""
    if not hasattr(solution, "reactions"):
        return [(np.array([[one]]), one) for one in solution.frequencies]
    rod = solution.model.bodies[0].space.rod
    u = rod.axis.breaks[0] + np.array(_ALONG) * (rod.axis.breaks[-1] - rod.axis.breaks[0])
    moved = solution.at(0, u, np.array(_ACROSS)).reshape(-1, 3)
    return [*estimates.carried(solution), (moved, float(np.linalg.norm(moved, axis=1).max()))]


def _stress_off(stress: Array, exact: Array) -> float:
    """Return the largest difference of stresses ``(q, 3, 3)``, relative to the largest of the exact ones."""
    if not len(exact):
        return 0.0
    return float(np.linalg.norm(stress - exact, axis=(1, 2)).max() / np.linalg.norm(exact, axis=(1, 2)).max())


def coarser(space: Space, seed: int) -> Space:
    """Return a random space on the rod of a chosen one, with at most as many elements."""
    rng, rod = np.random.default_rng([seed, 37]), space.rod
    degree = int(rng.integers(max(2, rod.axis.degree), 6))
    elements = int(rng.integers(1, 1 + cast(int, space.elements) // rod.axis.elements)) * rod.axis.elements
    across: dict[str, Any] = {"section_degree": int(rng.integers(1, 6))}
    if space.section_degree is None:
        across = {"order": int(rng.integers(1, 4)), "section_points": space.points_around}
    return Space(rod, elements, degree, int(rng.choice([0, degree - 1])), **across)


def compare(seed: int, coarse: bool = False) -> dict[str, Any]:
    """Return errors, estimates and warnings of one random file; ``coarse`` on a random space."""
    kind, text = draw(seed)
    record: dict[str, Any] = {"seed": seed, "kind": kind}
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        path = Path(folder) / "random.toml"
        path.write_text(text)
        scene = FileScene(str(path))
        spaces = [body.space for body in scene.model().bodies]
        run = scene.on([coarser(one, seed) for one in spaces]) if coarse else scene
        solution, seconds = solving.solve(run, run.settings())
        errors = solution.errors() if hasattr(solution, "errors") else (solution.estimate(), None)
        record |= {"space": str(solution.model.bodies[0].space), "seconds": seconds["total"]}
        record["warned"] = [str(one.message) for one in caught]
        solutions = [solution]
        for level in (1, 2):
            better = scene.on([finer(space, level) for space in spaces])
            solutions.append(solving.solve(better, better.settings())[0])
    works = [_works(one) for one in solutions]
    large = np.abs(works[2]) > _NOTHING * np.abs(works[2]).max()
    off, apart = (float(np.abs(one[large] / works[2][large] - 1.0).max()) for one in works[:2])
    carried = [estimates.carried(one) for one in solutions]
    off, apart = (
        max(one, estimates.off(those, carried[2])) for one, those in zip((off, apart), carried[:2], strict=True)
    )
    answers = [_answers(one) for one in solutions]
    record |= {"estimate": errors[0], "error": off, "apart": apart}
    record |= {"answers": estimates.off(answers[0], answers[2]), "answers apart": estimates.off(answers[1], answers[2])}
    if hasattr(solution, "reactions"):
        # Places of the estimate, and other places.
        rings = solution.model.bodies[0].space.rod.rings
        u, xi = stresses.away(solution.model, 0), stresses.around(rings)
        if not u.size:
            return record
        everywhere = [one.stress(0, u, xi).reshape(-1, 3, 3) for one in solutions]
        beyond, near = (_stress_off(one, everywhere[2]) for one in everywhere[:2])
        record |= {"stress error": beyond, "stress estimate": errors[1] or 0.0, "stress apart": near}
        places = [cast(Array, estimates.stresses_at(seed, one)) for one in solutions]
        here, beside = (_stress_off(one, places[2]) for one in places[:2])
        record |= {"stress at places": here, "stress at places apart": beside}
    return record


def silent(record: Mapping[str, Any]) -> bool:
    """Return whether a result is certainly off by too much, without an estimate or a warning of that."""
    if record["warned"] or (record["estimate"] or 0.0) > estimates.LARGE:
        return False
    if record["answers"] - record["answers apart"] > estimates.LARGE:
        return True
    off, apart = record.get("stress at places", 0.0), record.get("stress at places apart", 0.0)
    return bool(
        off - apart > estimates.LARGE_STRESS and (record.get("stress estimate") or 0.0) <= estimates.WARNED_STRESS
    )


def table(records: Sequence[Mapping[str, Any]], refused: Mapping[str, int]) -> list[dict[str, Any]]:
    """Return a row a kind, and one of all."""
    rows = []
    for kind in (*STATICS, *MODES, ""):
        those = [one for one in records if kind in ("", one["kind"])]
        row: dict[str, Any] = {"kind": kind or "all", "files": len(those)}
        row["refused"] = sum(refused.values()) if not kind else refused.get(kind, 0)
        for of in ("", "stress "):
            statistics = estimates.statistics([estimates.ratio(one, estimates.APART[1], of) for one in those])
            row |= {f"{of}counted": statistics["counted"], f"{of}within 3": statistics.get("within 3")}
        row["stress at places"] = max((one.get("stress at places", 0.0) for one in those), default=None)
        row["answers"] = max((one["answers"] for one in those if not one["warned"]), default=None)
        row["warned"] = sum(bool(one["warned"]) or (one["estimate"] or inf) > estimates.LARGE for one in those)
        row["silent"] = [one["seed"] for one in those if silent(one)]
        rows.append(row)
    return rows


def _too_long(*_: Any) -> None:
    raise TimeoutError("takes too long")


def main(arguments: Sequence[str]) -> int:
    """Run as many as are asked for."""
    options.initialize([])
    records: list[dict[str, Any]] = []
    refused: dict[str, int] = {}
    coarse = "coarse" in arguments
    numbers = [int(one) for one in arguments if one != "coarse"] or [100]
    seconds = numbers[2] if len(numbers) > 2 else 0
    signal.signal(signal.SIGALRM, _too_long)
    for seed in range(*numbers[:2]):
        try:
            signal.alarm(seconds)
            records.append(compare(seed, coarse))
        except (InputError, SolveError) as problem:
            kind = draw(seed)[0]
            refused[kind] = refused.get(kind, 0) + 1
            print(results.line({"seed": seed, "kind": kind, "refused": str(problem)}), flush=True)
            continue
        except Exception as problem:
            # Other failures are results too, and no reason to stop.
            print(results.line({"seed": seed, "kind": draw(seed)[0], "failed": repr(problem)}), flush=True)
            continue
        finally:
            signal.alarm(0)
        print(results.line(records[-1] | {"silent": silent(records[-1])}), flush=True)
    for row in table(records, refused):
        print(results.line(row), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
