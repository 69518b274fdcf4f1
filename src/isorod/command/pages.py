"""The help pages of ``isorod COMMAND --help``: what each command does, reads and writes, and an example."""

_SCENE = "SCENE [--option value ...]"
_PETSC = "[-petsc_option value ...]"

USAGES = {
    "run": f"{_SCENE} {_PETSC}",
    "show": _SCENE,
    "plot": "DIR [--option value ...]",
    "view": "DIR [--run int] [--port int] [--no-browser]",
    "sweep": f"{_SCENE} {_PETSC}",
    "design": f"{_SCENE} --vary NAME=LOWER:UPPER --target NAME=VALUE",
    "identify": f"{_SCENE} --table FILE.csv --vary NAME=LOWER:UPPER",
    "matrices": f"{_SCENE} {_PETSC} --output DIR",
    "mesh": "SCENE [FILE ...] [--option value ...]",
    "section": f"{_SCENE} {_PETSC}",
    "compare": "SCENE [--level {quick,full}] [--ranks N] [--results DIR]",
}

# A SCENE is a ready one, or a file.
SCENES = """\
A SCENE is a name from 'isorod list', or a file NAME.toml ('isorod new' writes one)."""

PETSC = "Options with a single dash go to PETSc untouched (-snes_monitor, -ksp_type gmres, -log_view, -help ...)."

PAGES = {
    "run": """\
Solves a scene, and prints its results with an error estimate.
reads    the scene, and the data files that its file names
writes   with --output DIR: record (results.jsonl), fields (.vtu), curves (.csv); else nothing
example  isorod run spring --coils 4.5 --travel 3
         isorod run my.toml --tolerance 1e-3 --output results
more     isorod run SCENE --help: all options of the scene and of its analysis""",
    "show": """\
Shows the rods of a scene with control points, supports, loads and obstacles, before anything is solved.
reads    the scene, and the data files that its file names
writes   with --png FILE: a picture; else a window opens
example  isorod show my.toml --png my.png --view 1,0,0""",
    "plot": """\
Plots results of a run: fields on the deformed shape, animations, or curves.
reads    a results folder (isorod run SCENE --output DIR), or a .vtu, .pvd or .csv file of it
writes   with --png or --gif: a file; else a window opens
example  isorod plot results --colour displacement --png shape.png
         isorod plot results --curve --png curve.pdf""",
    "view": """\
Shows results of a run in a browser: rotate, step through times, load steps and modes, and read off
fields at the points clicked. The server listens on this machine only; Ctrl-C ends it.
reads    a results folder (isorod run SCENE --output DIR), or a .vtu or .pvd file of it
writes   nothing
example  isorod view results
         isorod view results --port 8090 --no-browser     (on another machine: ssh -L 8090:127.0.0.1:8090 there)""",
    "sweep": """\
Solves a scene for all combinations of option values, and prints them as a table.
reads    the scene, and the data files that its file names
writes   with --output FILE.csv: the table, and beside it a record of each point (.jsonl); with --png: a plot
example  isorod sweep spring --travel 0:10:21 --nu 0.3,0.4 --output force.csv --png force.png""",
    "design": """\
Varies numbers of a scene, within bounds, until its results meet targets and limits; optionally minimises or
maximises mass, volume or a result.
reads    the scene, and the data files that its file names
writes   with --output FILE.toml: the scene file with the optimal parameters; else nothing
example  isorod design spring --vary wire_radius=0.6:1.5,coils=2:6 --target force=8 --minimise volume
         isorod design my.toml --vary rod.beam.section.circle=2:8 --limit "deflection>-1" --minimise volume
more     isorod run SCENE --derivatives: the numbers that may vary, and the derivatives with respect to them""",
    "identify": """\
Fits numbers of a scene, such as constants of its laws, to measured results: least squares, with standard
errors. The table has a column for each number that was set (named as for --set) and each measured result.
reads    the scene, the data files that its file names, and the table
writes   nothing
example  isorod identify my.toml --table test.csv --vary rod.beam.law.NeoHookean
more     isorod run SCENE --derivatives: the numbers that may vary""",
    "matrices": """\
Writes stiffness and mass of a scene, for other programs.
reads    the scene, and the data files that its file names
writes   into --output DIR: matrices, and the meaning of their rows
example  isorod matrices blade --output blade""",
    "mesh": """\
Writes curved hexahedra of a scene's rods.
reads    the scene, and the data files that its file names
writes   each FILE: .msh (gmsh), .inp (Abaqus, CalculiX), .vtu (VTK); SCENE.msh where none is named
example  isorod mesh my.toml my.inp --level 2""",
    "section": """\
Prints stiffness and mass per length of a rod's cross-section, 6 x 6, for beam programs.
reads    the scene, and the data files that its file names
writes   with --output FILE.csv: the matrices; else nothing
example  isorod section my.toml --rod wire""",
    "compare": """\
Compares a scene with finite elements (dolfinx) on meshes of the same geometry: errors against run times.
reads    the scene (a file NAME.toml, spring or blade), and the data files that its file names
writes   into --results DIR (results): records, pictures and report.html
example  isorod compare my.toml --results my-report
options  --level quick, or full: finer meshes, up to an hour each (quick)
         --ranks N: both programs on N ranks of MPI (1)
other    python -m comparisons --help: studies""",
    "list": """\
Lists the ready scenes and the examples, with their analyses.
example  isorod list""",
    "new": """\
Writes a commented scene file to begin with, and the data that it reads; overwrites nothing.
writes   NAME.toml (my.toml)
example  isorod new bar.toml && isorod run bar.toml
         isorod new knot.toml --from trefoil       ('isorod list' shows the examples)""",
    "compile": """\
Compiles all functions ahead of the first run, which otherwise does so when it needs them.
writes   beside the package, or into NUMBA_CACHE_DIR
example  isorod compile""",
    "doctor": """\
Shows versions, what is missing and how to get it.
example  isorod doctor""",
}


def page(command: str) -> str:
    """Return the page of a command that takes a scene or a result, with its usage."""
    more = [SCENES] if "SCENE" in USAGES[command] else []
    more += [PETSC] if _PETSC in USAGES[command] else []
    return "\n".join([f"usage: isorod {command} {USAGES[command]}\n", PAGES[command], *more])
