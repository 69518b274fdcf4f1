"""Random ties beside one rod: bars cut in two with contrasts of moduli, cores in sleeves beside layered rods.

``python -m comparisons.joints.random_ties FIRST LAST`` draws cases by their numbers and prints what each gives: the
relative difference of the free end's displacement to that of one body on a close space, a warning, or a refusal.
"""

import sys
import warnings
from collections import Counter
from typing import Any

import numpy as np

from isorod import CenterLine, InputError, NeoHookean, Rod, SolveError, Space, arc, circle, statics, straight
from isorod.model import Body, EndFace, LateralSurface, Model, SectionLoad, Support, Tie
from isorod.model.tie import Surface

# A difference of more than this counts as wrong where nothing is said.
WRONG = 5e-3


def main(first: int, last: int) -> int:
    """Draw the cases of numbers ``first .. last - 1``; return how many are wrong in silence."""
    told: Counter[str] = Counter()
    for number in range(first, last):
        rng = np.random.default_rng([34, number])
        kind = ("cut", "sleeve", "apart")[rng.choice(3, p=(0.6, 0.25, 0.15))]
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            try:
                outcome, what = _CASES[kind](rng)
            except (InputError, SolveError) as problem:
                outcome, what = "refused", str(problem)
        if outcome == "wrong" and said:
            outcome, what = "warned of", f"{what}; {said[-1].message}"
        told[outcome] += 1
        print(f"{number:5d} {kind:7s} {outcome:9s} {what}", flush=True)
    print(", ".join(f"{name} {count}" for name, count in sorted(told.items())))
    return told["wrong"]


def _space(rng: np.random.Generator, rod: Rod) -> Space:
    """Return a space of a random kind on a rod, now and then that which is chosen."""
    kind = rng.integers(4)
    if kind == 0:
        return Space(rod)
    along: dict[str, Any] = {"elements": rod.axis.elements * int(rng.integers(2, 5)), "degree": int(rng.integers(3, 6))}
    if kind == 1:
        return Space(rod, section_degree=int(rng.integers(3, 6)), **along)
    return Space(rod, order=int(rng.integers(2, 4)), **along)


def _either(rng: np.random.Generator, first: Surface, second: Surface) -> Tie:
    """Return the tie of two surfaces, either of them the slave."""
    return Tie(first, second) if rng.random() < 0.5 else Tie(second, first)


def _judged(solution: statics.Equilibrium, found: Any, exact: Any) -> tuple[str, str]:
    """Return an outcome and the difference: where it is large the estimate must say so."""
    difference = float(np.linalg.norm(found - exact) / np.linalg.norm(exact))
    if difference < WRONG:
        return "right", f"{difference:.1e}"
    estimate = solution.errors().work
    known = estimate is not None and estimate > 0.5 * difference
    return ("estimated" if known else "wrong"), f"{difference:.1e}, estimated {estimate}"


def _force(rng: np.random.Generator, law: NeoHookean, radius: float, length: float) -> tuple[float, float, float]:
    """Return a force that bends a rod by some hundredths of its length."""
    way = rng.standard_normal(3)
    bending = law.E * radius**4 / length**2
    return tuple(rng.uniform(0.01, 0.1) * bending * way / np.linalg.norm(way))


def _cut(rng: np.random.Generator) -> tuple[str, str]:
    """Bend a bar or an arc that is cut across and welded, of two materials."""
    radius, length = 10.0 ** rng.uniform(-1, 1), 0.0
    length = radius * rng.uniform(4.0, 20.0)
    place = rng.uniform(0.25, 0.75)
    laws = [NeoHookean(10.0 ** rng.uniform(-1, 1), rng.uniform(0.0, 0.4)) for _ in range(2)]
    curved = rng.random() < 0.4

    def line(begin: float, end: float) -> CenterLine:
        if not curved:
            return straight(start=(0, 0, begin * length), end=(0, 0, end * length))
        angle = 80.0
        return arc(length / np.radians(angle), (end - begin) * angle, phase=begin * angle)

    rods = [line(*ends).sweep(circle(int(rng.integers(6, 13)), radius)) for ends in ((0.0, place), (place, 1.0))]
    spaces = [_space(rng, rod) for rod in rods]
    surfaces = [EndFace(0, "end"), EndFace(1, "start")]
    tie = _either(rng, *surfaces)
    bodies = [Body(space, law) for space, law in zip(spaces, laws, strict=True)]
    force = _force(rng, laws[0], radius, length)
    model = Model(
        bodies,
        [Support.end(spaces[0], "start")],
        loads=[SectionLoad.end(spaces[1], "end", force, body=1)],
        ties=[tie],
    )
    solved = statics.solve(model)
    fine = [Space(rod, section_degree=6, elements=8 * rod.axis.elements, degree=5) for rod in rods]
    finer = Model(
        [Body(space, law) for space, law in zip(fine, laws, strict=True)],
        [Support.end(fine[0], "start")],
        loads=[SectionLoad.end(fine[1], "end", force, body=1)],
        ties=[Tie(surfaces[0], surfaces[1])],
    )
    return _judged(solved, solved.at(1, "end"), statics.solve(finer).at(1, "end"))


def _sleeve(rng: np.random.Generator) -> tuple[str, str]:
    """Bend a core that is welded in a sleeve, beside a rod in two layers."""
    radius, share = 10.0 ** rng.uniform(-1, 1), rng.uniform(0.3, 0.8)
    length = radius * rng.uniform(4.0, 12.0)
    laws = [NeoHookean(10.0 ** rng.uniform(-1, 1), rng.uniform(0.0, 0.4)) for _ in range(2)]
    core = straight(length).sweep(circle(int(rng.integers(6, 13)), share * radius))
    whole = straight(length).sweep(circle(8, radius))
    spaces = [
        _space(rng, core),
        Space(whole.with_rings((share, 1.0)), section_degree=int(rng.integers(3, 6)), elements=4, degree=4),
    ]
    surfaces = [LateralSurface(0), LateralSurface(1, surface="inner")]
    tie = _either(rng, *surfaces)
    force = np.array(_force(rng, laws[1], radius, length))
    area = share**2
    loads = [
        SectionLoad.end(space, "end", tuple(part * force), body=b)
        for b, (space, part) in enumerate(zip(spaces, (area, 1.0 - area), strict=True))
    ]
    bodies = [Body(space, law) for space, law in zip(spaces, laws, strict=True)]
    held = [Support.end(space, "start", body=b) for b, space in enumerate(spaces)]
    solved = statics.solve(Model(bodies, held, loads=loads, ties=[tie]))
    layered = Space(whole.with_rings((0.0, share, 1.0)), section_degree=6, elements=8, degree=5)
    loads = [SectionLoad.end(layered, "end", tuple(force))]
    one = statics.solve(Model([Body(layered, laws)], [Support.end(layered, "start")], loads=loads))
    return _judged(solved, solved.at(0, "end"), one.at(0, "end"))


def _apart(rng: np.random.Generator) -> tuple[str, str]:
    """Weld two bars whose faces are apart or aside: one carries the other along when it is turned, or it is refused."""
    radius, gap = 1.0, rng.uniform(0.0, 0.3)
    aside = rng.standard_normal(3) * gap
    lower = straight(6.0).sweep(circle(8, radius))
    upper = straight(start=np.array([0.0, 0.0, 6.0]) + aside, end=np.array([0.0, 0.0, 12.0]) + aside).sweep(
        circle(8, radius * rng.uniform(0.6, 1.0))
    )
    spaces = [_space(rng, lower), _space(rng, upper)]
    law = NeoHookean(1.0, 0.3)
    bodies = [Body(space, law) for space in spaces]
    # A turn of the clamped end carries the other one along.
    turn = (0.0, 0.2, 0.0)
    model = Model(
        bodies,
        [Support.end(spaces[0], "start", turn=turn, center=(0, 0, 0))],
        ties=[Tie(EndFace(1, "start"), EndFace(0, "end"))],
    )
    solved = statics.solve(model)
    place = np.array([0.0, 0.0, 12.0]) + aside
    cos, sin = np.cos(0.2), np.sin(0.2)
    turned = np.array([cos * place[0] + sin * place[2], place[1], -sin * place[0] + cos * place[2]])
    return _judged(solved, solved.position(1, "end"), turned)


_CASES = {"cut": _cut, "sleeve": _sleeve, "apart": _apart}


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2])) > 0)
