"""A scene's statics as a program of dolfinx that reads the mesh beside it: short, to be read and changed."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from isorod.errors import InputError
from isorod.material import symbols
from isorod.material.law import Material
from isorod.model.load import BodyForce, Pressure, SectionLoad, Weight
from isorod.model.model import Model
from isorod.model.support import Support
from meshes import deck, deck_names, groups
from meshes.held import Held, surface
from meshes.mesh import Mesh

_TEMPLATE = Path(__file__).with_name("script.txt")

# Load steps of laws for large displacements, at least.
_STEPS = 4

# A place is that of a node if it is as near, a fraction of the mesh's size.
_SAME = 1e-9

_FUNCTIONS = {"log": "ln"}


def check(scene: Any, model: Model) -> None:
    """Raise `InputError` in one line if something of a scene is not written as a program of dolfinx."""
    missing = next(_missing(scene, model), None)
    if missing:
        raise InputError(f"{scene.name}: {missing}; .msh has the mesh with its groups")


def _missing(scene: Any, model: Model) -> Any:
    """Yield what is not written."""
    if scene.analysis != "statics":
        yield f"{scene.analysis} is not written to .py, statics is"
    if any(getattr(one, "history", None) is not None for one in (*model.supports, *model.loads)):
        yield "a history is not written to .py"
    for what, several in (("contact", model.contacts), ("tie", model.ties), ("solid", model.solids)):
        if several:
            yield f"{scene.named(f'{what} 0')} is not written to .py"
    if model.spin is not None:
        yield "a spin is not written to .py"
    for k, support in enumerate(model.supports):
        name = scene.named(f"support {k}")
        if not isinstance(support, Support):
            yield f"{name}: mean motions and springs are not written to .py"
            continue
        motion = model.motions[k]
        if support.tied or motion.during != (0.0, 1.0) or len(motion.path) > 2:
            yield f"{name}: what is tied, or moves for a time or on a path, is not written to .py"
        if motion.turn.any() and support.components != "xyz":
            yield f"{name}: what turns and is free in a component is not written to .py"
    for k, load in enumerate(model.loads):
        name = scene.named(f"load {k}")
        if isinstance(load, SectionLoad):
            ends = model.bodies[load.body].space.axis.breaks[[0, -1]]
            if load.turns or (load.u is not None and np.abs(ends - load.u).min() > _SAME * np.ptp(ends)):
                yield f"{name}: moments, and forces on a section within a rod, are not written to .py"
        elif not isinstance(load, Pressure | BodyForce | Weight):
            yield f"{name}: {type(load).__name__} is not written to .py"
    for body in model.bodies:
        for law in body.laws:
            if law.families or symbols.activation in law.stored.expression.free_symbols:
                yield f"law {type(law).__name__}: fibres and activation are not written to .py"
            if not np.isfinite(law.constants).all():
                yield f"law {type(law).__name__}: incompressible, displacements alone are not; give it a bulk modulus"


def write(scene: Any, model: Model, mesh: Mesh, path: Path) -> tuple[str, list[str]]:
    """Return the program of a scene, whose mesh ``path`` with ``.msh`` is, and notes on it."""
    check(scene, model)
    names = deck_names.names_of(scene, mesh)
    kinds = list(groups.kinds(mesh, model, names))
    laws, energy = [], []
    for k, kind in enumerate(kinds):
        laws += [
            f"def energy_{k}(F):",
            f'    """{type(kind.law).__name__} of {kind.name}."""',
            *_energy(kind.law),
            "",
            "",
        ]
        energy.append(f'over("{kind.name}", energy_{k}(F), dx)')
    steps = 1 if all(kind.law.linear for kind in kinds) else max(_STEPS, scene.settings().get("load_steps", 1))
    supports, turns = [], 0.0
    for k in range(len(model.supports)):
        supports.append(_support(scene, model, mesh, k))
        turns = max(turns, float(np.degrees(np.linalg.norm(model.motions[k].turn))))
    measures, notes = _measures(scene, model, mesh)
    text = _TEMPLATE.read_text()
    for key, value in {
        "TITLE": scene.title.replace('"', "'").replace("\\", "/"),
        "MESH": path.with_suffix(".msh").name,
        "DEGREE": str(mesh.order),
        "LAWS": "\n".join(laws).rstrip(),
        "ENERGY": " + ".join(energy),
        "LOADS": "\n".join(_loads(scene, model, names, kinds)) or "# None.",
        "SUPPORTS": "\n".join(supports),
        "STEPS": str(max(steps, int(np.ceil(turns / deck.ANGLE)))),
        "MEASURES": "\n".join(measures),
    }.items():
        text = text.replace(f"@{key}@", value)
    return text, notes


def _energy(law: Material) -> list[str]:
    """Return lines that compute a law's energy of ``F``."""
    expression = law.stored.expression
    names = {one.name for one in expression.free_symbols}
    constants = dict(zip((one.name for one in law.stored.constants), law.constants, strict=True))
    lines = [f"{', '.join(constants)} = {', '.join(f'{float(value):.12g}' for value in constants.values())}"]
    stretches = {one.name for one in symbols.stretches}
    needed = {"J": "ufl.det(F)", "I1": "ufl.tr(C)", "I2": "(ufl.tr(C) ** 2 - ufl.tr(C * C)) / 2"}
    if names & ({"I1", "I2"} | stretches) or any(re.fullmatch(r"C\d\d", name) for name in names):
        lines.append("C = F.T * F")
    lines += [f"{name} = {how}" for name, how in needed.items() if name in names]
    if names & stretches:
        lines.append(f"{', '.join(sorted(stretches))} = stretches(C)")
    text = re.sub(r"\b([FC])(\d)(\d)\b", r"\1[\2, \3]", str(expression))
    text = re.sub(r"\b([a-zA-Z]\w*)\(", lambda one: f"ufl.{_FUNCTIONS.get(one[1], one[1])}(", text)
    return [f"    {line}" for line in [*lines, f"return {text}"]]


def _vector(values: Any) -> str:
    return "(" + ", ".join(f"{float(value) + 0.0:.12g}" for value in values) + ")"


def _loads(scene: Any, model: Model, names: deck_names.Names, kinds: list[groups.Kind]) -> list[str]:
    """Return the lines of loads: their work on ``v`` at load factor ``factor``."""
    lines = []
    for k, load in enumerate(model.loads):
        name = scene.named(f"load {k}")
        if isinstance(load, SectionLoad):
            work = f'over("{name}", ufl.dot(ufl.as_vector({_vector(load.force or (0, 0, 0))}), v) / area("{name}"), ds)'
        elif isinstance(load, Pressure):
            normal = "ufl.det(F) * ufl.inv(F).T * normal" if load.follows else "normal"
            work = f'over("{name}", -{load.pressure:.12g} * ufl.dot({normal}, v), ds)'
        elif isinstance(load, BodyForce | Weight):
            rod, parts = names[f"rod {load.body}"], []
            for kind in kinds:
                if kind.name == rod or kind.name.startswith(f"{rod} law "):
                    force = load.density if isinstance(load, BodyForce) else kind.density * np.array(load.acceleration)
                    parts.append(f'over("{kind.name}", ufl.dot(ufl.as_vector({_vector(force)}), v), dx)')
            work = " + ".join(parts)
        lines.append(f"residual -= factor * ({work})  # {name}")
    return lines


def _support(scene: Any, model: Model, mesh: Mesh, k: int) -> str:
    """Return the line of a support."""
    support, motion = model.supports[k], model.motions[k]
    assert isinstance(support, Support)
    space = model.bodies[support.body].space
    moved = Held(k, model, surface(mesh, support.body, space))
    words = [f'"{scene.named(f"support {k}")}"', f'"{support.components}"']
    if motion.turn.any():
        nodes = np.asarray(support.nodes)
        control_points = space.is_control_point[nodes]
        centre = (space.positions[nodes] - np.asarray(support.arms))[control_points].mean(axis=0)
        shift = [motion.path[-1][motion.dofs % 3 == a][0] for a in range(3)]
        words += [_vector(shift), f"turn={_vector(motion.turn)}", f"centre={_vector(centre)}"]
    else:
        values = moved.displacement(1.0)
        if np.ptp(values, axis=0).max() > _SAME * (1.0 + np.abs(values).max()):
            raise InputError(
                f"{scene.name}: {scene.named(f'support {k}')} moves by more than one displacement; not written"
            )
        words.append(_vector(values[0]))
    return f"hold({', '.join(words)})"


def _measures(scene: Any, model: Model, mesh: Mesh) -> tuple[list[str], list[str]]:
    """Return the lines that print what the scene measures, and notes on what they leave out."""
    lines, notes = [], []
    for what, asked in scene.content.get("measure", {}).items():
        component = f'["xyz".index("{asked["component"]}")]' if "component" in asked else ""
        kind = next((one for one in ("reaction", "moment", "displacement", "energy") if one in asked), "")
        value = ""
        if kind in ("reaction", "moment"):
            value = f'{kind}("support {asked[kind]}"){component}'
        elif kind == "energy":
            rod = f"rod {asked[kind]}"
            parts = [
                k
                for k, name in enumerate(_kinds_of(scene, model, mesh))
                if name == rod or name.startswith(f"{rod} law ")
            ]
            names = list(_kinds_of(scene, model, mesh))
            value = " + ".join(f'integral("{names[k]}", energy_{k}(F), dx)' for k in parts)
        elif kind == "displacement":
            body = model.bodies[scene.rod_names().index(asked[kind])]
            rod = body.space.rod
            xi = asked.get("xi", (0.0, 0.0))
            place = rod.points([xi], [asked.get("u", rod.axis.breaks[-1])])[0]
            if np.linalg.norm(mesh.points - place, axis=1).min() < _SAME * np.ptp(mesh.points):
                value = f"displacement({_vector(place)}){component}"
        if value:
            lines.append(f'print("{what:16}", {value}, "{asked.get("unit", "")}")')
        else:
            notes.append(f"measure {what}: not in the .py")
    return lines, notes


def _kinds_of(scene: Any, model: Model, mesh: Mesh) -> list[str]:
    return [kind.name for kind in groups.kinds(mesh, model, deck_names.names_of(scene, mesh))]
