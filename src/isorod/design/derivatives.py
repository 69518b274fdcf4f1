"""Derivatives of what a scene measures by its parameters."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from isorod.design import parameters
from isorod.errors import InputError

if TYPE_CHECKING:
    from isorod.model.model import Model
    from isorod.statics.differences import Derivatives


def refuse(scene: Any) -> None:
    """Raise `InputError` for analyses whose answers are not differentiated."""
    if scene.analysis not in ("statics", "modal"):
        raise InputError(f"derivatives: not available in {scene.analysis}; they are in statics and modal")


def of(scene: Any, solution: Any, names: "Mapping[str, float] | None" = None) -> "Derivatives":
    """Return the derivatives of what a scene measures of its solution, by parameters of it.

    Parameters
    ----------
    scene, solution
        The scene, and what was solved of it.
    names
        Parameters with their values; all where not given.

    Raises
    ------
    InputError
        If there are none (`isorod.statics.derivatives.derivatives`).
    """
    refuse(scene)
    asked = parameters.parameters(scene) if names is None else names

    def make(values: Mapping[str, float]) -> "Model":
        model: Model = parameters.at(scene, values).model()
        return model

    with scene.locating():
        return solution.derivatives(make, asked, scene.measure)  # type: ignore[no-any-return]
