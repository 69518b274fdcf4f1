"""What can be combined, as small scenes in files: analyses with features and options, and with sections."""

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

ANALYSES = {
    "statics": "[analysis.statics]",
    "modes": "[analysis.modal]\nmodes = 3",
    "implicit": '[analysis.dynamics]\nend_time = 0.2\ntime_step = 0.1\noutputs = 2\nintegrator = "implicit"',
    "explicit": "[analysis.dynamics]\nend_time = 0.2\noutputs = 2\nintegrator = 'explicit'",
}

_SOFT = "law = {NeoHookean = {E = 100.0, nu = 0.3}}"
_ROD = f"[rod.a]\ncurve = {{straight = 6.0}}\nsection = {{circle = 1.0}}\ndensity = 1.0\n{_SOFT}\n"
_HELD = '[support.foot]\nend = "start"\n'
_PULLED = '[support.hand]\nend = "end"\ndisplacement = [0.05, 0.3, 0.0]\n'
# A motion begins with the jump of the support: fibres that it strains by a third are as stiff as nothing else, and the
# functions of a layered section take many iterations.
_NUDGED = _PULLED.replace("[0.05, 0.3, 0.0]", "[0.005, 0.03, 0.0]")
_WALL = "[obstacle.wall]\nCylinder = {point = [0.0, 6.1, 4.5], axis = [1.0, 0.0, 0.0], radius = 5.0}\n"
# What touches is soft and on few elements: a patch as wide as this one needs no more, and each cell is quick.
_SOFTLY = "penalty = 30.0\n"
_TOUCH = '[contact.wall]\nfirst = "a"\nsecond = "wall"\n' + _SOFTLY
_FEW = _ROD + "space = {elements = 4, degree = 3, order = 2, section_points = 8}\n"
_COIL = _FEW.replace("straight = 6.0", "helix = 3.0, pitch = 2.2, turns = 1.5").replace(
    "elements = 4, degree = 3", "elements = 12, degree = 4"
)
_GOH = "law = {HolzapfelGasserOgden = {c = 20.0, k1 = 40.0, k2 = 0.5, bulk = 100.0}}"

FEATURES = {
    "plain": _ROD + _HELD + _PULLED,
    "contact": _FEW + _HELD + _PULLED + _WALL + _TOUCH,
    "self-contact": _COIL + _HELD + '[support.hand]\nend = "end"\ndisplacement = [0.0, 0.0, -0.5]\n'
    '[contact.coils]\nfirst = "a"\n' + _SOFTLY,
    "friction": _FEW + _HELD + _PULLED + _WALL + _TOUCH + "friction = 0.2\n",
    "mixed": (_ROD + _HELD + _PULLED).replace("nu = 0.3", "nu = 0.4999"),
    "hollow": _ROD + "rings = [0.6, 1.0]\n" + _HELD + _PULLED,
    "layered": _ROD.replace(
        _SOFT,
        "rings = [0.0, 0.6, 1.0]\nlaw = [{NeoHookean = {E = 300.0, nu = 0.3}}, {NeoHookean = {E = 100.0, nu = 0.3}}]",
    )
    + _HELD
    + _NUDGED,
    "fibres": _ROD.replace(_SOFT, _GOH) + _HELD + _NUDGED,
    "spin": _ROD + _HELD + _PULLED + "[spin]\nvelocity = [0.3, 0.0, 0.0]\n",
    "turned ends": _ROD + _HELD + '[support.hand]\nend = "end"\nrotation = [0.0, 0.0, 30.0]\n',
}

# The words behind ``isorod run FILE``; ``compare`` and ranks are commands of their own.
OPTIONS = {
    "alone": [],
    "--tolerance": ["--tolerance", "0.05"],
    "--output": ["--output", "out"],
    "--set": ["--set", "rod.a.density=1.2"],
    "--checkpoint": ["--checkpoint", "state"],
    "two ranks": [],
    "compare": [],
}

# Each section: what its space is, its rings, and whether there are several laws.
_CONTROL, _POLYNOMIALS = "order = 2, section_points = 8", "section_degree = 3"
SECTIONS = {
    "control points": (_CONTROL, "rings = [0.0, 1.0]\n", False),
    "polynomials": (_POLYNOMIALS, "rings = [0.0, 1.0]\n", False),
    "hollow": (_POLYNOMIALS, "rings = [0.5, 1.0]\n", False),
    "layered": (_POLYNOMIALS, "rings = [0.0, 0.6, 1.0]\n", True),
    "layered tube": (_POLYNOMIALS, "rings = [0.3, 0.6, 1.0]\n", True),
}

_LAWS = {
    "steel": "{NeoHookean = {E = 100.0, nu = 0.3}}",
    "rubber": "{NeoHookean = {E = 100.0, nu = 0.5}}",
    "tendon": "{HolzapfelGasserOgden = {c = 20.0, k1 = 40.0, k2 = 0.5, bulk = 100.0}}",
    "wet tendon": "{HolzapfelGasserOgden = {c = 20.0, k1 = 40.0, k2 = 0.5, bulk = inf}}",
}
_OUTER, _INNER = (
    f'[support.hand]\nend = "end"\n[load.gas]\npressure = 0.5\nsurface = "{where}"\nfollows = true\n'
    for where in ("outer", "inner")
)
_PATCH = "[support.hand]\npatch = {around = [-30, 30], along = [2.0, 4.0]}\ndisplacement = [0.05, 0.1, 0.0]\n"
_AT_REST = ANALYSES["modes"] + "\nat_rest = true"

# What each section is asked for: the law, or that of the first of several, what is held and loads, the analysis, ranks.
CASES = {
    "statics": ("steel", _PULLED, ANALYSES["statics"], 1),
    "modes": ("steel", "", _AT_REST, 1),
    "prestressed modes": ("steel", _PULLED, ANALYSES["modes"], 1),
    "implicit motion": ("steel", _PULLED, ANALYSES["implicit"], 1),
    "explicit motion": ("steel", _PULLED, ANALYSES["explicit"], 1),
    "mixed: statics": ("rubber", _PULLED, ANALYSES["statics"], 1),
    "mixed: modes": ("rubber", "", _AT_REST, 1),
    "mixed: prestressed modes": ("rubber", _PULLED, ANALYSES["modes"], 1),
    "mixed: implicit motion": ("rubber", _PULLED, ANALYSES["implicit"], 1),
    "mixed: explicit motion": ("rubber", _PULLED, ANALYSES["explicit"], 1),
    "fibres: statics": ("tendon", _NUDGED, ANALYSES["statics"], 1),
    "fibres: prestressed modes": ("tendon", _NUDGED, ANALYSES["modes"], 1),
    "fibres: implicit motion": ("tendon", _NUDGED, ANALYSES["implicit"], 1),
    "fibres: explicit motion": ("tendon", _NUDGED, ANALYSES["explicit"], 1),
    "fibres, mixed: statics": ("wet tendon", _NUDGED, ANALYSES["statics"], 1),
    "pressure that follows, outer: statics": ("steel", _OUTER, ANALYSES["statics"], 1),
    "pressure that follows, outer: prestressed modes": ("steel", _OUTER, ANALYSES["modes"], 1),
    "pressure that follows, outer: implicit motion": ("steel", _OUTER, ANALYSES["implicit"], 1),
    "pressure that follows, outer: explicit motion": ("steel", _OUTER, ANALYSES["explicit"], 1),
    "pressure that follows, inner: statics": ("steel", _INNER, ANALYSES["statics"], 1),
    "pressure that follows, inner, mixed: statics": ("rubber", _INNER, ANALYSES["statics"], 1),
    "pressure that follows, inner, mixed: prestressed modes": ("rubber", _INNER, ANALYSES["modes"], 1),
    "held patch: statics": ("steel", _PATCH, ANALYSES["statics"], 1),
    "two ranks: prestressed modes": ("steel", _PULLED, ANALYSES["modes"], 2),
    "two ranks: explicit motion": ("steel", _PULLED, ANALYSES["explicit"], 2),
    "two ranks, mixed: statics": ("rubber", _PULLED, ANALYSES["statics"], 2),
    "two ranks, mixed: implicit motion": ("rubber", _PULLED, ANALYSES["implicit"], 2),
}

# Rows and columns of each table.
TABLES = {analysis: (FEATURES, OPTIONS) for analysis in ANALYSES} | {"sections": (CASES, SECTIONS)}

_MEASURE = '[measure.push]\nreaction = "hand"\ncomponent = "y"\n'


def scene(analysis: str, feature: str) -> str:
    """Return the text of a scene."""
    measure = "" if analysis == "modes" else _MEASURE
    if feature == "self-contact":
        measure = measure.replace('"y"', '"z"')
    return f'title = "{feature}"\n{FEATURES[feature]}{measure}{ANALYSES[analysis]}\n'


def of_section(case: str, section: str, second: str = "steel") -> str:
    """Return the text of a scene of a section; of several laws the others are the ``second``."""
    (space, rings, several), (law, rest, analysis, _) = SECTIONS[section], CASES[case]
    laws = f"[{_LAWS[law]}, {_LAWS[second]}]" if several else _LAWS[law]
    rod = _ROD.replace(_SOFT, f"{rings}law = {laws}\nspace = {{elements = 4, degree = 3, {space}}}")
    return f'title = "{section}"\n{rod}{_HELD}{rest}{analysis}\n'


def outcome(
    table: str, row: str, column: str, folder: Path, seconds: float = 120.0, here: Callable | None = None
) -> tuple[int, str, str]:
    """Run a cell of a table, or have its words run ``here``; return exit code, standard output and standard error."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    words = ["run", "scene.toml", "--json"]
    if table == "sections":
        text, ranks = of_section(row, column), CASES[row][3]
    else:
        text, ranks = scene(table, row), 2 if column == "two ranks" else 1
        words = ["compare", "scene.toml"] if column == "compare" else [*words, *OPTIONS[column]]
    (folder / "scene.toml").write_text(text)
    if here is not None:
        with contextlib.chdir(folder):
            return here(words)
    call = [sys.executable, "-m", "isorod", *words]
    if ranks > 1:
        call = ["mpirun", "-n", str(ranks), *call]
    done = subprocess.run(call, cwd=folder, capture_output=True, text=True, timeout=seconds, env=_environment())
    return done.returncode, done.stdout, done.stderr


def _environment() -> dict[str, str]:
    more = {"OMP_NUM_THREADS": "1", "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    return dict(os.environ) | more | {"OMPI_MCA_rmaps_base_oversubscribe": "1"}


def refusal(code: int, out: str, err: str) -> str:
    """Return the line of a run that was refused, empty if it has an answer; raises `AssertionError` if it did neither.

    Warnings are lines of their own; a refusal has one line that is no warning, and no answer beside it, but for the
    best there is where a tolerance is not reached.
    """
    lines = [line for line in err.splitlines() if line.startswith(("isorod: ", "comparisons: "))]
    assert "Traceback" not in err, err
    if code == 0:
        assert out.strip(), "no answer"
        return ""
    assert code == 2, f"exit code {code}: {err}"
    line = lines[-1].partition(": ")[2] if lines else ""
    assert line and (" not reached: " in line or not out.strip()), f"an answer beside a refusal: {out}"
    # What is short then, memory or time, is another machine's.
    return line.partition("; the refined model fails")[0]
