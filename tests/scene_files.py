"""Scene files for tests: valid ones, written as tables, and small wrong changes of them."""

import copy
import json
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

BEAM: dict[str, Any] = {
    "title": "beam",
    "analysis": {"statics": {"load_steps": 1}},
    "rod": {
        "beam": {
            "curve": {"straight": {"length": 4.0, "breaks": [0.0, 0.5, 1.0], "continuity": 0}},
            "section": {"ellipse": {"a": 0.5, "b": 0.4, "n": 4}},
            "law": [{"NeoHookean": {"E": 100.0, "nu": 0.3}}, {"StVenantKirchhoff": {"E": 50.0, "nu": 0.2}}],
            "formulation": "displacement",
            "space": {"elements": 4, "degree": 2, "order": 1, "section_points": 4, "quadrature": "auto"},
        }
    },
    "support": {
        "root": {"end": "start", "components": "xyz"},
        "tip": {"end": "end", "components": "z", "displacement": [0.0, 0.0, 0.01], "rotation": [0.0, 0.0, 0.0]},
        "band": {"patch": {"around": [-10.0, 10.0], "along": [1.0, 2.0]}, "components": "y"},
    },
    "load": {
        "pull": {"end": "end", "force": [0.0, 0.001, 0.0], "rod": "beam"},
        "weight": {"body_force": [0.0, -0.001, 0.0]},
        "push": {"section": 0.5, "force": [0.001, 0.0, 0.0]},
        "line": {"per_length": [0.0, 1e-4, 0.0]},
    },
    "measure": {
        "tip": {"displacement": "beam", "u": 1.0, "xi": [0.5, 0.0], "component": "y", "unit": "mm"},
        "force": {"reaction": "tip", "component": "z"},
        "moment": {"moment": "root"},
    },
}
PAIR: dict[str, Any] = {
    "analysis": "statics",
    "rod": {
        "low": {
            "curve": {"straight": 3.0},
            "section": {"circle": 0.5, "n": 4},
            "law": {"NeoHookean": {"E": 100.0, "nu": 0.3}},
            "space": {"elements": 2, "degree": 2},
        },
        "high": {
            "curve": {"helix": {"radius": 4.0, "pitch": 1.0, "turns": 1.0, "arcs_per_turn": 4}},
            "section": {"circle": 0.5, "n": 4},
            "law": {"NeoHookean": {"E": 100.0, "nu": 0.3}},
            "space": {"degree": 2},
        },
    },
    "support": {
        "a": {"end": "start", "rod": "low"},
        "b": {"end": "end", "rod": "low"},
        "c": {"end": "start", "rod": "high"},
        "d": {"end": "end", "rod": "high", "displacement": [0.0, 0.0, 0.01]},
    },
    "obstacle": {
        "floor": {"Plane": {"point": [0.0, -2.0, 0.0], "normal": [0.0, 1.0, 0.0]}},
        "pin": {"Cylinder": {"point": [-2.0, 0.0, 0.0], "axis": [0.0, 0.0, 1.0], "radius": 0.5}},
    },
    "contact": {
        "rods": {"first": "low", "second": "high", "penalty": 100.0},
        "floor": {"first": "low", "second": "floor", "penalty": 100.0, "points": [3, 3]},
        "pin": {"first": "low", "second": "pin", "penalty": 100.0, "first_elements": [0, 1]},
    },
    "measure": {"touch": {"contact_force": "floor"}},
}
MODES: dict[str, Any] = {
    "analysis": {"modal": {"modes": 3, "lumped": False}},
    "spin": {"velocity": [0.0, 0.0, 0.0], "center": [0.0, 0.0, 0.0]},
    "rod": {
        "blade": {
            "curve": {"straight": 4.0},
            "section": {"naca": {"digits": "0012", "n": 8, "chord": 1.0}},
            "law": {"LinearElastic": {"E": 100.0, "nu": 0.3}},
            "density": 1.0,
            "space": {"section_degree": 2, "elements": 2},
        }
    },
    "support": {"root": {"end": "start"}},
}
MOTION: dict[str, Any] = {
    "analysis": {"dynamics": {"end_time": 0.001, "outputs": 2, "damping": 1.0, "ramp": 0.0, "integrator": "explicit"}},
    "rod": {
        "muscle": {
            "curve": {"straight": 2.0},
            "section": {"flower": {"n": 4, "petals": 0, "radius": 0.5, "depth": 0.0}},
            "law": {"Muscle": {"E": 30.0, "nu": 0.3, "sigma_max": 10.0, "m1": 1.0, "m2": 0.5, "activation": 1.0}},
            "density": 1.0,
        }
    },
    "support": {"root": {"end": "start"}},
    "measure": {"tip": {"displacement": "muscle"}},
}
WELD: dict[str, Any] = {
    "analysis": "statics",
    "rod": {
        "lower": {
            "curve": {"straight": 4.0},
            "section": {"circle": 1.0},
            "law": {"LinearElastic": {"E": 26.0, "nu": 0.3}},
            "density": 2.0,
            "space": {"section_degree": 2, "elements": 2},
        },
        "upper": {
            "curve": {"straight": {"length": 3.0, "start": [0.0, 0.0, 4.0]}},
            "section": {"circle": 1.0},
            "law": {"LinearElastic": {"E": 2.4, "nu": 0.2}},
            "density": 1.0,
            "space": {"section_degree": 2, "elements": 2},
        },
    },
    "support": {"foot": {"end": "start", "rod": "lower"}},
    "load": {"pull": {"end": "end", "rod": "upper", "force": [0.0, 0.0, 0.001]}},
    "tie": {"weld": {"slave": "upper.start", "master": "lower.end", "gap": 0.1}},
    "measure": {"torque": {"tie_moment": "weld"}, "force": {"tie_force": "weld", "component": "z"}},
}
RING: dict[str, Any] = {
    "analysis": "geometry",
    "rod": {
        "ring": {
            "curve": {"helix": {"radius": 4.0, "pitch": 0.0, "turns": 1.0, "arcs_per_turn": 4}},
            "section": {"outline": "outline.csv", "n": 4},
            "closed": True,
        }
    },
}
WIRE: dict[str, Any] = {
    "analysis": "geometry",
    "rod": {
        "wire": {
            "curve": {"polyline": "line.csv", "tolerance": 0.01, "closed": False, "normal": [1.0, 0.0, 0.0]},
            "section": {"circle": 0.1, "n": 6},
            "scale": [1.0, 1.5, 1.0],
            "twist": 30.0,
            "end_section": {"ellipse": {"a": 0.1, "b": 0.15, "n": 6}},
        },
        "bow": {"curve": {"arc": 4.0, "angle": 45.0, "phase": 10.0}, "section": {"circle": 0.1}},
        "spline": {"curve": {"nurbs": "line.csv", "degree": 2, "weights": [1.0, 2.0, 1.0]}, "section": {"circle": 0.1}},
    },
}
VALID = {"wire": WIRE, "beam": BEAM, "pair": PAIR, "modes": MODES, "motion": MOTION, "weld": WELD, "ring": RING}
LINE = "x,y,z\n0,0,0\n0,1,1\n0,0,3\n"
OUTLINE = "\n".join(f"{math.cos(t)},{math.sin(t)}" for t in (2.0 * math.pi * k / 12 for k in range(12)))

# Names that are the user's: another one there is as good.
NAMED = ("rod", "support", "load", "obstacle", "contact", "tie", "measure")

# Values out of range, by the key that has them; None is for every number.
OUT_OF_RANGE: dict[str, list[Any]] = {
    **{key: [0.0, -1.0] for key in "E length radius penalty end_time arc".split()},
    **{key: [-1.0] for key in "b density damping ramp sigma_max m1 tolerance".split()},
    **{key: [0.0] for key in "a chord".split()},
    **{key: [0, -1] for key in "load_steps outputs turns".split()},
    **{key: [7.0] for key in "u section".split()},
    **{key: [[0.0, 0.0, 0.0]] for key in "axis normal".split()},
    **{key: ["bem"] for key in "displacement rod".split()},
    "nu": [0.6, -1.0],
    "breaks": [[0.0, 0.5, 0.25], [1.0], []],
    "continuity": [-1, 7],
    "n": [2, 0, -3, 100000],
    "circle": [0.0, -0.5],
    "formulation": ["mixd"],
    "elements": [0, -2],
    "degree": [0, 9],
    "order": [0, 7],
    "section_points": [2, 5],
    "section_degree": [0, 99],
    "quadrature": ["best", "0x1x2"],
    "components": ["xyw", ""],
    "around": [[10.0, -10.0], [0.0, 400.0]],
    "along": [[2.0, 1.0], [-1.0, 2.0], [1.0, 9.0]],
    "modes": [0, -3, 10000],
    "points": [[0, 3], [3, 100]],
    "first_elements": [[7], []],
    "digits": ["abc", "00"],
    "integrator": ["implcit"],
    "petals": [-1],
    "depth": [1.0, -1.0],
    "activation": [2.0, -1.0],
    "arcs_per_turn": [2, 0],
    "component": ["w", "zz"],
    "end": ["strat", ""],
    "reaction": ["tipp"],
    "angle": [0.0, 400.0],
    "weights": [[1.0, 0.0, 1.0], [1.0, 2.0]],
    "scale": [[1.0, -1.0, 1.0], [1.0, 2.0], [1.0]],
    "first": ["floor", "lo"],
    "second": ["low", "flor"],
    "slave": ["upper.strat", "lower.end", "upper"],
    "master": ["lower.outre", "uper.end"],
    "gap": [0.0, -1.0],
}


class Mutant(NamedTuple):
    """A scene with one thing wrong: what, where it is, and what the complaint must name."""

    scene: str
    change: str
    table: dict[str, Any]
    place: tuple[str | int, ...]


def text(table: dict[str, Any]) -> str:
    """Return a scene as TOML: plain keys first, then a table for each thing that has a name."""
    rows = []
    for key, value in table.items():
        if key not in (*NAMED, "spin") or not isinstance(value, dict):
            rows.append(f"{key} = {_value(value)}")
    for key, several in table.items():
        if key == "spin" and isinstance(several, dict):
            rows += ["[spin]", *(f"{name} = {_value(one)}" for name, one in several.items())]
        elif key in NAMED and isinstance(several, dict):
            for name, one in several.items():
                if isinstance(one, dict):
                    rows += ["", f"[{key}.{name}]", *(f"{inner} = {_value(each)}" for inner, each in one.items())]
                else:
                    rows += ["", f"[{key}]", f"{name} = {_value(one)}"]
    return "\n".join(rows) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_value(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    return str(value) if isinstance(value, float) else json.dumps(value)


def leaves(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    """Yield the place of each key and its value, tables before what is in them."""
    if path:
        yield path, value
    inner: Any = value.items() if isinstance(value, dict) else ()
    if isinstance(value, list) and value and isinstance(value[0], dict):
        inner = enumerate(value)
    for key, one in inner:
        yield from leaves(one, (*path, key))


def mutants() -> Iterator[Mutant]:
    """Yield every scene with every small wrong change."""
    for name, table in VALID.items():
        for path, value in leaves(table):
            for change, key, wrong in _wrong(path, value):
                mutated = copy.deepcopy(table)
                above: Any = mutated
                for step in path[:-1]:
                    above = above[step]
                if key != path[-1]:
                    # In place of the old one, in its order.
                    items = [(key if one == path[-1] else one, each) for one, each in above.items()]
                    above.clear()
                    above.update(items)
                else:
                    above[key] = wrong
                yield Mutant(name, change, mutated, (*path[:-1], key))


def _wrong(path: tuple[str | int, ...], value: Any) -> Iterator[tuple[str, Any, Any]]:
    """Yield what is wrong, the key and the value of each change of what stands at a place."""
    key = path[-1]
    own = len(path) == 2 and path[0] in NAMED
    if isinstance(key, str) and not own:
        yield "key", key + "x", value
        yield "key", key[:-1] + key[-1].swapcase() if key[-1].isalpha() and len(key) > 1 else f"{key}_", value
    if isinstance(value, dict):
        yield "type", key, ["wrong"]
        return
    is_name = isinstance(value, str)
    yield "type", key, {"wrong": 1}
    yield "type", key, 7 if is_name else "wrong"
    if not isinstance(value, bool):
        yield "type", key, True
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield "NaN", key, math.nan
        yield "NaN", key, math.inf
        yield "unit", key, f"{value} mm"
        if isinstance(value, int):
            yield "type", key, value + 0.5
    if isinstance(value, list) and value and isinstance(value[0], int | float):
        yield "NaN", key, [math.nan, *value[1:]]
        yield "type", key, [*value[:-1], "wrong"]
        yield "type", key, [*value[:-1], [1.0]]
    if is_name and value.endswith(".csv"):
        yield "data", key, "missing.csv"
        yield "data", key, "../"
    for wrong in OUT_OF_RANGE.get(str(key), []):
        if isinstance(wrong, str) == is_name and isinstance(wrong, list) == isinstance(value, list):
            yield "range", key, wrong
