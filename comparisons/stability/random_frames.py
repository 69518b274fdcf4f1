"""Random scenes of slender rods, and what a frame of thin bars says of what they measure."""

import itertools
from typing import Any

import numpy as np

from comparisons.stability import random_lines
from comparisons.stability.frame import Bar, Frame
from comparisons.stability.random_lines import Line

Array = Any
Table = dict[str, Any]

ANALYSES = ("statics", "modal", "buckling")

# So much of its length a load may move a rod.
_MOVES = 1e-4


def draw(seed: int) -> tuple[Table, dict[str, Any]]:
    """Return a scene's tables, and what a frame says of each measure, or of its frequencies or load factors."""
    rng = np.random.default_rng([seed, 47])
    return _Scene(rng).finish()


class _Scene:
    """A scene while it is drawn, beside its frame."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.frame = rng, Frame()
        self.radius = 10.0 ** rng.uniform(-1.0, 1.0)
        self.analysis = str(rng.choice(ANALYSES, p=(0.7, 0.2, 0.1)))
        self.tables: Table = {"analysis": {self.analysis: {"modes": 4} if self.analysis != "statics" else {}}}
        self.modulus, self.density = 10.0 ** rng.uniform(0.0, 5.5), 10.0 ** rng.uniform(-9.0, 0.0)
        self.wanted: dict[str, Any] = {}
        self.names: list[str] = []
        self.lines: list[Line] = []
        self.nodes: list[list[int]] = []
        self.bars: list[Bar] = []
        self._rods()
        self._supports()
        if self.analysis != "modal":
            self._loads()
        self._measures()

    def _put(self, kind: str, what: Table) -> str:
        several = self.tables.setdefault(kind, {})
        name = f"{kind}{len(several)}"
        several[name] = what
        return name

    def _rods(self) -> None:
        rng = self.rng
        kinds = ["straight"] if self.analysis == "buckling" else ["straight", "arc", "helix", "chain", "fillet"]
        first = str(rng.choice(kinds))
        self._rod(first, None)
        if self.analysis != "buckling" and rng.random() < 0.25:
            # Another one that goes on from its end, welded to it.
            self._weld()
        if len(self.names) == 1 and rng.random() < 0.15 and self.analysis == "statics":
            rod = self.tables["rod"][self.names[0]]
            rod["copy"] = {"move": [0.0, 500.0 * self.radius, 0.0], "count": 2}

    def _rod(self, kind: str, start: Any, line: Line | None = None) -> None:
        rng, name = self.rng, "abc"[len(self.names)]
        line = line or random_lines.draw(rng, self.radius, kind, start=start)
        round_ = kind != "straight" or start is not None
        section, bar, more = self._section(round_)
        nodes = self.frame.line(line.points, bar, line.normal, self.nodes[-1][-1] if self.nodes else None)
        self.tables.setdefault("rod", {})[name] = {"curve": line.text, "section": section} | more
        self.names.append(name)
        self.lines.append(line)
        self.nodes.append(nodes)
        self.bars.append(bar)

    def _weld(self) -> None:
        start = self.lines[0].points[-1]
        way = self.lines[0].ends[1]
        length = self.radius * self.rng.uniform(60.0, 120.0)
        points = np.linspace(start, start + length * way, 241)
        text = {"straight": {"start": start.tolist(), "end": points[-1].tolist()}}
        self._rod("straight", start, Line(text, points, np.zeros(3), 1.0, (way, way)))
        self._put("tie", {"slave": "b.start", "master": "a.end"})

    def _section(self, round_: bool) -> tuple[Table, Bar, Table]:
        rng, r, nu = self.rng, self.radius, float(rng_choice(self.rng, (0.0, 0.2, 0.3, 0.33, 0.45)))
        modulus = self.modulus * 10.0 ** rng.uniform(-0.5, 0.0)
        law = str(rng.choice(["LinearElastic", "LinearElastic", "NeoHookean", "StVenantKirchhoff"]))
        if self.analysis == "buckling" and law == "LinearElastic":
            law = "NeoHookean"
        more: Table = {"law": {law: {"E": modulus, "nu": nu}}}
        area, inertia = np.pi * r**2, np.pi * r**4 / 4.0
        kind = str(rng.choice(["circle", "tube", "layers", "ellipse"], p=(0.5, 0.15, 0.1, 0.25)))
        if kind == "ellipse" and round_:
            kind = "circle"
        density = self.density
        shear = 6.0 * (1.0 + nu) / (7.0 + 6.0 * nu)
        if kind == "ellipse":
            b = r * float(rng.uniform(0.4, 0.9))
            area, both = np.pi * r * b, (np.pi * r * b**3 / 4.0, np.pi * r**3 * b / 4.0)
            torsion = np.pi * r**3 * b**3 / (r**2 + b**2)
            g = modulus / (2.0 * (1.0 + nu))
            bar = Bar(modulus * area, shear * g * area, (modulus * both[0], modulus * both[1]), g * torsion)
            mass, polar = density * area, density * sum(both)
            more["density"] = density
            return {"ellipse": {"a": r, "b": b}}, _massive(bar, mass, polar), more
        stiff = [(modulus, nu, 0.0, 1.0)]
        if kind == "tube":
            inner = float(rng.uniform(0.4, 0.8))
            more["rings"], stiff = [inner, 1.0], [(modulus, nu, inner, 1.0)]
        if kind == "layers":
            inner, soft = float(rng.uniform(0.4, 0.8)), modulus * float(10.0 ** rng.uniform(-1.5, 0.0))
            more["rings"] = [0.0, inner, 1.0]
            more["law"] = [{law: {"E": one, "nu": nu}} for one in (modulus, soft)]
            stiff = [(modulus, nu, 0.0, inner), (soft, nu, inner, 1.0)]
        axial = sum(e * area * (o**2 - i**2) for e, _, i, o in stiff)
        bending = sum(e * inertia * (o**4 - i**4) for e, _, i, o in stiff)
        share = more["rings"][0] if kind == "tube" else 0.0
        mass, polar = density * area * (1.0 - share**2), 2.0 * density * inertia * (1.0 - share**4)
        if kind == "tube":
            m = (1.0 + share**2) ** 2
            shear = 6.0 * (1.0 + nu) * m / ((7.0 + 6.0 * nu) * m + (20.0 + 12.0 * nu) * share**2)
        more["density"] = density
        g = 1.0 / (2.0 * (1.0 + nu))
        bar = Bar(axial, shear * g * axial, (bending, bending), 2.0 * g * bending)
        return {"circle": r}, _massive(bar, mass, polar), more

    def _hold(self, node: int, ways: Array, *, turn: bool = False) -> list[int]:
        return [self.frame.hold(node, way, turn=turn) for way in ways]

    def _supports(self) -> None:
        rng, line = self.rng, self.lines[0]
        straight = "straight" in line.text and len(self.names) == 1
        names = ["clamp", "fixed", "both", "spring"] + (["pins", "bearings", "forks"] if straight else ["hinge"])
        kind = str(rng.choice(names))
        self.kind = kind
        nodes, rod = self.nodes[0], {"rod": "a"} if len(self.names) > 1 else {}
        last = self.names[-1]
        other = {"rod": last} if len(self.names) > 1 else {}
        start, end, every = nodes[0], self.nodes[-1][-1], np.eye(3)
        low, high = line.ends[0], self.lines[-1].ends[1]
        self.held: dict[str, tuple[list[int], list[int]]] = {}

        def held(what: Table, node: int, moves: Array, turns: Array) -> None:
            name = self._put("support", what)
            self.held[name] = (self._hold(node, moves), self._hold(node, turns, turn=True))

        clamp = {"end": "start"} | rod | ({"mean": "fixed"} if rng.random() < 0.3 or kind == "fixed" else {})
        if kind in ("clamp", "fixed", "spring", "hinge"):
            held(clamp, start, every, every)
        if kind == "both":
            held(clamp, start, every, every)
            held({"end": "end"} | other, end, every, every)
        if kind == "spring":
            size = self.bars[-1].EI[0] / self.lines[-1].length ** 3
            push = (size * rng.uniform(0.0, 30.0, 3)).tolist()
            turn = (size * self.lines[-1].length ** 2 * rng.uniform(0.0, 3.0, 3)).tolist()
            what: Table = {"spring": "end", "stiffness": push} | other
            if rng.random() < 0.5:
                what["rotational"] = turn
            else:
                turn = [0.0] * 3
            self._put("support", what)
            self.frame.springs += [(6 * end + k, one) for k, one in enumerate([*push, *turn])]
        if kind == "hinge":
            axis = _across(rng, high)
            held(
                {"end": "end", "mean": "hinge", "axis": axis.tolist()} | other,
                end,
                every,
                np.array([high, np.cross(high, axis)]),
            )
        if kind in ("pins", "forks"):
            held({"end": "start", "mean": "fork"}, start, every, [low])
            across = [0, 1] if kind == "pins" else [0, 1, 2]
            what = {"end": "end", "mean": "pin"} | ({"components": "xy"} if kind == "pins" else {})
            held(what, end, every[across], [])
        if kind == "bearings":
            held({"end": "start", "mean": "fork", "components": "z"}, start, every[2:], [low])
            for share in (0.1, float(rng.choice([0.7, 0.9, 1.0 / 1.25]))):
                share = round(share * 240) / 240
                held({"bearing": share}, nodes[round(share * (len(nodes) - 1))], every[:2], [])
        if kind in ("clamp", "fixed") and rng.random() < 0.3 and self.analysis == "statics":
            # A support that moves, of the mean in some components.
            moved = _MOVES * line.length * rng.normal(size=3)
            letters = str(rng.choice(["xyz", "x", "yz"]))
            what = {"end": "end", "mean": "pin", "components": letters, "displacement": moved.tolist()} | other
            name = self._put("support", what)
            at = ["xyz".index(one) for one in letters]
            self.held[name] = ([self.frame.hold(end, every[k], float(moved[k])) for k in at], [])

    def _loads(self) -> None:
        rng, several = self.rng, int(self.rng.integers(1, 4))
        self.cases: list[str] = []
        if self.analysis == "buckling":
            size = 0.2 * min(self.bars[0].EI) / self.lines[0].length ** 2
            kind = str(rng.choice(["end", "line", "both"]))
            if kind != "line":
                self._put("load", {"end": "end", "force": [0.0, 0.0, -size]})
                self.frame.pull(self.nodes[0][-1], [0.0, 0.0, -size])
            if kind != "end":
                self._line([0.0, 0.0, -2.0 * size / self.lines[0].length], 0)
            return
        which = len(self.names) - 1
        length = sum(line.length for line in self.lines)
        size = _MOVES * min(self.bars[which].EI) / length**2
        for _ in range(several):
            kind = str(rng.choice(["force", "moment", "line", "section", "at", "gravity"]))
            if kind in ("force", "moment") and self.kind not in ("clamp", "fixed", "spring"):
                kind = "line"
            way = size * rng.normal(size=3)
            rod = {"rod": self.names[which]} if which else {}
            line, nodes = self.lines[which], self.nodes[which]
            if kind == "force":
                self._put("load", {"end": "end", "force": way.tolist()} | rod)
                self.frame.pull(nodes[-1], way)
            elif kind == "moment":
                moment = way * 0.3 * length
                self._put("load", {"end": "end", "moment": moment.tolist()} | rod)
                self.frame.pull(nodes[-1], moment, turn=True)
            elif kind == "line":
                self._line((way / length).tolist(), which)
            elif kind == "gravity" and "gravity" not in self.tables:
                self.tables["gravity"] = {
                    "acceleration": (way / (length * max(bar.mass for bar in self.bars))).tolist()
                }
                for k, bar in enumerate(self.bars):
                    self._spread(np.array(self.tables["gravity"]["acceleration"]) * bar.mass, k)
            elif kind in ("section", "at") and line.halved:
                share = 0.5
                node = nodes[round(share * (len(nodes) - 1))]
                if kind == "at" and "straight" in line.text and which == 0:
                    angle = float(rng.uniform(0.0, 360.0))
                    section = self.tables["rod"]["a"]["section"]
                    sizes = list(section["ellipse"].values()) if "ellipse" in section else [self.radius] * 2
                    arm = np.array([sizes[0] * np.cos(np.radians(angle)), sizes[1] * np.sin(np.radians(angle)), 0.0])
                    self._put("load", {"at": {"u": line.u(share), "angle": angle}, "force": way.tolist()})
                    self.frame.pull(node, way)
                    self.frame.pull(node, np.cross(arm, way), turn=True)
                else:
                    moment = way * 0.2 * length
                    self._put(
                        "load", {"section": line.u(share), "force": way.tolist(), "moment": moment.tolist()} | rod
                    )
                    self.frame.pull(node, way)
                    self.frame.pull(node, moment, turn=True)
        if "load" not in self.tables and "gravity" not in self.tables:
            self._line([size / length, size / length, 0.0], which)

    def _line(self, force: list[float], which: int) -> None:
        self._put("load", {"per_length": force} | ({"rod": self.names[which]} if len(self.names) > 1 else {}))
        self._spread(np.array(force), which)

    def _spread(self, force: Array, which: int) -> None:
        nodes, places = self.nodes[which], self.frame.places
        for one, other in itertools.pairwise(nodes):
            length = float(np.linalg.norm(places[other] - places[one]))
            for node in (one, other):
                self.frame.pull(node, 0.5 * length * force)

    def _measures(self) -> None:
        if self.analysis != "statics":
            return
        last, copies = self.names[-1], "copy" in self.tables["rod"]["a"]
        name = f"{last}-1" if copies else last
        self.tables["measure"] = {"turn_end": {"rotation": name}}
        if self.kind in ("clamp", "fixed", "spring", "bearings"):
            self.tables["measure"]["moved_end"] = {"displacement": name}
        for support, (moves, turns) in self.held.items():
            of = f"{support}-2" if copies else support
            kind = self.tables["support"][support]
            if len(moves) == 3 and "displacement" not in kind:
                self.tables["measure"][f"force_{support}"] = {"reaction": of}
                if len(turns) == 3:
                    self.tables["measure"][f"moment_{support}"] = {"moment": of}
        line = self.lines[0]
        if line.halved:
            self.tables["measure"]["moved_middle"] = {"displacement": name if last == "a" else "a", "u": line.u(0.5)}

    def finish(self) -> tuple[Table, dict[str, Any]]:
        """Return the scene, and what its frame says."""
        frame = self.frame
        if self.analysis == "modal":
            return self.tables, {"frequencies": frame.frequencies(4)}
        frame.solve()
        if self.analysis == "buckling":
            return self.tables, {"factors": frame.factors(4)}
        end = self.nodes[-1][-1]
        found: dict[str, Any] = {
            "length": np.array(sum(line.length for line in self.lines)),
            "turn_end": np.degrees(frame.moved[end, 3:]),
        }
        if "moved_end" in self.tables["measure"]:
            found["moved_end"] = frame.moved[end, :3]
        for support, (moves, turns) in self.held.items():
            if f"force_{support}" in self.tables["measure"]:
                found[f"force_{support}"] = frame.held[moves]
            if f"moment_{support}" in self.tables["measure"]:
                found[f"moment_{support}"] = frame.held[turns]
        if "moved_middle" in self.tables["measure"]:
            found["moved_middle"] = frame.moved[self.nodes[0][len(self.nodes[0]) // 2], :3]
        return self.tables, found


def rng_choice(rng: np.random.Generator, values: Any) -> Any:
    """Return one of the values."""
    return values[int(rng.integers(len(values)))]


def _massive(bar: Bar, mass: float, polar: float) -> Bar:
    return Bar(bar.EA, bar.GA, bar.EI, bar.GJ, mass, polar)


def _across(rng: np.random.Generator, way: Array) -> Array:
    axis = np.cross(way, rng.normal(size=3))
    return axis / np.linalg.norm(axis)
