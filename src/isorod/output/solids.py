"""What states say of finite element bodies beside the rods."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.errors import whole_number
from isorod.model.model import Model


class WithSolids:
    """A state of a model with finite element bodies (`isorod.output.state.State`)."""

    model: Model
    solids: Sequence[Array]

    def function(self, solid: int = 0) -> Any:
        """Return the displacement of one of the model's solids as a dolfinx Function; collective."""
        number = whole_number("solid", solid, 0, len(self.model.solids) - 1)
        return self.model.solids[number].function(self.solids[number])


def owned(model: Model, everywhere: Array) -> list[Array]:
    """Return what this rank has of each solid's degrees of freedom, given those of all, one solid behind the other."""
    found, first = [], 0
    for solid in model.solids:
        begin, end = (first + 3 * node for node in solid.owned)
        found.append(np.array(everywhere[begin:end]))
        first += 3 * solid.nodes
    return found
