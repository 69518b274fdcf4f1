"""Study ``joints``: rods welded to rods and to finite element bodies, beside exact solutions and one solid."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from comparisons.measure.study import Run


def run(study: "Run") -> None:
    """Run the scenes (`comparisons.joints.study`), for which alone dolfinx and gmsh are loaded."""
    from comparisons.joints import study as scenes

    scenes.run(study)
