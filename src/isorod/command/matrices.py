"""``isorod matrices``: stiffness and mass of a scene, as files for other programs."""

import argparse
from collections.abc import Sequence
from typing import Any

from isorod import options, scenes
from isorod.command import chosen, ending, notes
from isorod.command.parser import Parser
from isorod.errors import InputError


def main(ours: Sequence[str], theirs: Sequence[str]) -> int:
    """Write the matrices of a scene with our options and PETSc's; return the exit code."""
    import numpy as np

    if chosen.usage("matrices", ours, theirs):
        return 0
    scene, args, _ = chosen.choose("matrices", ours, theirs, more)
    if scene.analysis == "geometry":
        raise InputError("matrices: this scene is geometry only, which has none; 'isorod list' names others")
    with np.errstate(all="ignore"), options.petsc_errors():
        options.initialize(theirs)
        from isorod.command.solving import origin, refuse_unused
        from isorod.output import matrix_files

        matrix_files.check_folder(args.output)
        matrices = _matrices(scene, args)
        refuse_unused()
        if ending.rank() == 0:
            readme = matrix_files.write(matrices, args.output, origin(scene))
            notes.show()
            print(_summary(readme, args.output))
    return 0


def more(parser: Parser, scene: Any) -> None:
    """Add options of the scene's analysis, and of the files."""
    if {"statics", "modal"} & {*scenes.analyses(scene)}:
        chosen.with_load_steps(parser, scene)
    parser.add_argument(
        "--at-rest",
        action="store_true",
        help="linearise about the undeformed state (statics and modes: about the equilibrium; dynamics: undeformed)",
    )
    parser.add_argument("--mass", choices=("consistent", "lumped"), help="mass matrix (consistent)")
    parser.add_argument("--output", metavar="DIR", required=True, help="write into this folder, a new or an empty one")


def _matrices(scene: Any, args: argparse.Namespace) -> Any:
    """Return the requested matrices."""
    from isorod.command import solving
    from isorod.output.matrices import matrices

    # Settings of the analysis are read before anything is solved.
    settings = scene.settings()
    lumped = args.mass == "lumped" or (args.mass is None and bool(settings.get("lumped")))
    with scene.locating():
        model = scene.model()
        if scene.analysis == "dynamics":
            model = model.in_motion(settings.get("integrator", "explicit"))
        if scene.analysis == "modal" and not (args.at_rest or settings.get("at_rest")):
            from isorod.modal import loaded

            steps = getattr(args, "load_steps", None) or settings.get("load_steps", 1)
            return matrices(model, loaded.find(model, steps), lumped)
        if scene.analysis != "statics" or args.at_rest:
            return matrices(model, None, lumped)
        if model.contacts:
            raise InputError(
                "matrices about a solution with contact: the active contact set is not stored; use --at-rest for the "
                "undeformed state"
            )
    solution, _ = solving.solve(scene, chosen.settings(scene, args))
    return solution.matrices(lumped)


def _summary(readme: dict[str, Any], folder: str) -> str:
    """Return a summary of the files written."""
    entries = "; ".join(f"{name} of {count:,} entries" for name, count in readme["entries"].items())
    mass = "" if "mass" in readme["entries"] else f"; mass {readme['mass']}"
    names = ", ".join(name for name in readme["files"] if not name.endswith(".csv"))
    return (
        f"{readme['unknowns']:,} unknowns ({readme['degrees_of_freedom']:,} degrees of freedom), "
        f"about {readme['about']}; {entries}{mass}\n"
        f"written to {folder}: {names}, each as .mtx, .bin and .npz or .npy; README.json describes them"
    )
