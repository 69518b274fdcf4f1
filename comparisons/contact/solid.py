"""A spring pushed to solid, on finer and finer spaces: ``python -m comparisons.contact.solid``.

One JSON line a space: the travel to solid, from where forces past it lead back to that at touch, and what stack of
wires that the turns then are takes for a hundredth of a wire's radius, beside `comparisons.contact.coil`.
"""

import sys
import warnings
from typing import Any

from comparisons.contact.coil import Coil
from isorod import options, scenes, statics
from isorod.output import results

TURNS = 2

# Travel past touch, over the wire's radius.
PAST = 0.015, 0.025

# Control points round the wire, elements a turn.
SPACES = (8, 8), (8, 16), (16, 8)


def solid(section_points: int, elements: int, steps: int = 10) -> dict[str, Any]:
    """Return travel to solid and stiffness of the stack by a space, and their exact values."""
    scene = scenes.find("coil")(coils=TURNS, section_points=section_points, elements_per_turn=elements)
    wire = Coil(scene.coil_radius, 2.0 * scene.wire_radius, TURNS, scene.lead, scene.E, scene.nu)
    touch, measured = wire.touch(), list[dict[str, Any]]()
    travels = [touch + share * scene.wire_radius for share in PAST]
    for travel in travels:
        pushed = scenes.find("coil")(
            coils=TURNS, section_points=section_points, elements_per_turn=elements, travel=travel
        )
        measured.append(pushed.measure(statics.solve(pushed.model(), load_steps=steps)))
    free = wire.force(touch)
    forces = [one["force"] - free for one in measured]
    stiffness = (forces[1] - forces[0]) / (travels[1] - travels[0])
    expected = (forces[1] - forces[0]) / (wire.flattened(forces[1]) - wire.flattened(forces[0]))
    return {
        "solid": travels[0] - forces[0] / stiffness,
        "touch": touch,
        "stiffness": stiffness,
        "flattened": expected,
        "spring": free / touch,
        "forces": forces,
        "penetration": max(one["relative_penetration"] for one in measured),
    }


def main() -> int:
    """Solve on all spaces."""
    options.initialize([])
    # Lines of contact are far narrower than control points are apart.
    warnings.filterwarnings("ignore", message="contact 0: ")
    for section_points, elements in SPACES:
        record = {"section_points": section_points, "elements_per_turn": elements}
        print(results.line(record | solid(section_points, elements)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
