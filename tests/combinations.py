"""What can be combined: each analysis with each feature and each option, as a small scene in a file."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ANALYSES = {
    "statics": "[analysis.statics]",
    "modes": "[analysis.modal]\nmodes = 3",
    "implicit": '[analysis.dynamics]\nend_time = 0.2\ntime_step = 0.1\noutputs = 2\nintegrator = "implicit"',
    "explicit": "[analysis.dynamics]\nend_time = 0.2\noutputs = 2",
}

_SOFT = "law = {NeoHookean = {E = 100.0, nu = 0.3}}"
_ROD = f"[rod.a]\ncurve = {{straight = 6.0}}\nsection = {{circle = 1.0}}\ndensity = 1.0\n{_SOFT}\n"
_HELD = '[support.foot]\nend = "start"\n'
_PULLED = '[support.hand]\nend = "end"\ndisplacement = [0.05, 0.3, 0.0]\n'
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
    + _PULLED,
    # A motion begins with the jump of the support: fibres that it strains by a third are as stiff as nothing else.
    "fibres": _ROD.replace(_SOFT, _GOH) + _HELD + _PULLED.replace("[0.05, 0.3, 0.0]", "[0.005, 0.03, 0.0]"),
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

_MEASURE = '[measure.push]\nreaction = "hand"\ncomponent = "y"\n'


def scene(analysis: str, feature: str) -> str:
    """Return the text of a scene."""
    measure = "" if analysis == "modes" else _MEASURE
    if feature == "self-contact":
        measure = measure.replace('"y"', '"z"')
    return f'title = "{feature}"\n{FEATURES[feature]}{measure}{ANALYSES[analysis]}\n'


def outcome(analysis: str, feature: str, option: str, folder: Path, seconds: float = 120.0) -> tuple[int, str, str]:
    """Run a cell of the table; return exit code, standard output and standard error."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "scene.toml").write_text(scene(analysis, feature))
    words = ["compare", "scene.toml"] if option == "compare" else ["run", "scene.toml", "--json", *OPTIONS[option]]
    call = [sys.executable, "-m", "isorod", *words]
    if option == "two ranks":
        call = ["mpirun", "-n", "2", *call]
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
