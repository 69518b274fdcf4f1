"""What finite elements of rods do not have is refused before anything is meshed or solved; without dolfinx."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from isorod.errors import InputError
from isorod.files.solid import OfBody
from isorod.material.thermal import Thermal
from isorod.model.contact import Cylinder, Plane
from isorod.model.load import BodyForce, LineLoad, PointLoad, Pressure, SectionLoad, Weight
from isorod.model.mean import MeanSupport
from isorod.model.model import Model


@dataclass(frozen=True)
class Steps:
    """The keys of a file's ``[analysis.dynamics]``, see `isorod.dynamics.solve`."""

    end_time: float
    time_step: float | None = None
    outputs: int = 50
    damping: float = 0.0
    ramp: float = 0.0
    integrator: str = "explicit"

    def __post_init__(self) -> None:
        if self.integrator != "implicit" or self.time_step is None:
            raise InputError(
                "integrator: got explicit steps, finite elements take isorod's implicit ones; compare with integrator "
                '= "implicit" and a time_step'
            )

    @property
    def count(self) -> int:
        """Number of steps to each output."""
        assert self.time_step is not None
        return max(1, int(np.ceil(self.end_time / self.outputs / self.time_step - 1e-9)))

    @property
    def step(self) -> float:
        """The time step that is taken."""
        return self.end_time / self.outputs / self.count

    def level(self, time: float) -> float:
        """Return the fraction of the full activation at a time."""
        return 1.0 if self.ramp <= 0.0 else float(np.clip(time / self.ramp, 0.0, 1.0))


# Settings of each analysis that finite elements have.
_SETTINGS = {"statics": ("load_steps", "end_time"), "modal": ("modes",), "dynamics": tuple(Steps.__dataclass_fields__)}


def settings_of(scene: Any) -> dict[str, Any]:
    """Return those settings of a scene's analysis that finite elements take; raises `InputError` of any other."""
    if scene.analysis not in _SETTINGS:
        raise InputError(f"analysis {scene.analysis}: finite elements have statics, modal and dynamics")
    given = scene.settings()
    return {name: given[name] for name in _SETTINGS[scene.analysis] if name in given}


def with_pressures(model: Model) -> list[int]:
    """Return the bodies of a model whose pressures are unknowns of finite elements: those that are mixed in isorod.

    Bodies whose volumetric energy is no square are left out unless they are incompressible.
    """
    mixed = []
    for b, body in enumerate(model.bodies):
        if body.formulation != "mixed":
            continue
        bent = [np.isfinite(law.lame) and law.logarithmic and not law.stored.quadratic for law in body.laws]
        if not any(bent):
            mixed.append(b)
        elif any(not np.isfinite(law.lame) for law in body.laws):
            raise InputError(
                f"material of body {b}: incompressible beside one whose volumetric energy is no square of ln J, which "
                "finite elements with pressures do not have"
            )
    return mixed


def refuse_scene(scene: Any, model: Model) -> None:
    """Raise `InputError` for the first thing in a scene that finite elements have no counterpart of."""
    settings = settings_of(scene)
    refuse(model, scene.analysis, scene.bodies() if model.solids else ())
    if scene.analysis == "modal":
        _refuse_loaded(model, scene.settings())
    if scene.analysis == "dynamics":
        if settings.get("integrator") != "implicit" or settings.get("time_step") is None:
            raise InputError(
                f"integrator: finite elements take isorod's implicit steps; {_suggested_steps(model, settings)}"
            )
        Steps(**settings)


def _suggested_steps(model: Model, settings: Mapping[str, Any]) -> str:
    """Return the settings of steps that a file needs."""
    from isorod.command import steps

    step = steps.implicit(model, settings["end_time"], settings.get("outputs", 50), "").time_step
    return f'set integrator = "implicit" and time_step = {step:.2g}, which follows the lowest frequency and the tables'


def refuse(model: Model, analysis: str, bodies: Sequence[OfBody] = ()) -> None:
    """Raise `InputError` for the first thing in a model that finite elements have no counterpart of."""
    if model.remembers:
        _refuse_beside_memory(model, analysis)
    pressures = [] if model.remembers else with_pressures(model)
    laws = [law for body in model.bodies for law in body.laws]
    timed = any(getattr(one, "history", None) is not None for one in (*model.supports, *model.loads, *laws, model.spin))
    if timed and analysis != "dynamics" and not model.remembers:
        raise InputError("history: finite elements go to the full load alone; compare without steps and histories")
    for b, body in enumerate(model.bodies):
        for law in body.laws:
            if isinstance(law, Thermal) and (b in pressures or law.kind != (1, 0, False)):
                raise InputError(
                    f"temperature of body {b}: finite elements have one temperature and one coefficient of expansion, "
                    "of laws without pressures and without a table of stiffness"
                )
    for k, support in enumerate(model.supports):
        if isinstance(support, MeanSupport):
            if model.means[k].moduli:
                raise InputError(f"support {k}: finite elements have mean motions of sections of one law alone")
            if analysis == "dynamics" or model.ties or model.solids:
                raise InputError(
                    f"support {k}: finite elements have mean motions and springs in statics and modes of rods that are "
                    "not tied; compare these, or with a face that is held"
                )
        elif support.tied:
            raise InputError(f"support {k}: a tied face is not on the finite element side")
    for k, load in enumerate(model.loads):
        if load in model.following and isinstance(load, SectionLoad) and (analysis == "dynamics" or model.ties):
            raise InputError(
                f"load {k}: finite elements have moments on bodies that turn in statics of rods that are not tied"
            )
        if isinstance(load, PointLoad):
            raise InputError(
                f"load {k}: a force at a place has no limit to compare with; spread it, as a pressure or over a section"
            )
        if not isinstance(load, SectionLoad | Weight | BodyForce | Pressure | LineLoad):
            raise InputError(f"load {k}: {type(load).__name__} is not on the finite element side")
    for k in range(len(model.contacts)):
        _refuse_contact(model, k)
    tied = bool(model.ties or model.solids)
    if tied:
        _refuse_tied(model, bodies)
    if analysis == "dynamics":
        if model.spin is not None:
            raise InputError("spin: finite elements have no motions in a frame that rotates; give rods an initial one")
        for k, support in enumerate(model.supports):
            if support.clock.moves if isinstance(support, MeanSupport) else model.motions[k].clock.moves:
                raise InputError(
                    f"support {k}: finite elements have no supports that move by time; compare with one that stands"
                )
        if model.contacts:
            raise InputError("contact 0: finite elements have motions without contact alone; compare statics")
        if tied:
            raise InputError("ties: finite elements have no motions of rods that are tied; compare statics or modes")
        if pressures:
            raise InputError(
                f"material of body {pressures[0]}: nearly incompressible, which finite elements have in statics and "
                "modes alone; compare these, or with nu up to 0.49"
            )


def _refuse_beside_memory(model: Model, analysis: str) -> None:
    """Raise `InputError` for what finite elements do not have beside laws with memory."""
    beside = {
        "modes and motions": analysis != "statics",
        "nearly incompressible bodies": any(body.formulation == "mixed" for body in model.bodies),
        "contact": bool(model.contacts),
        "ties and bodies": bool(model.ties or model.solids),
        "mean motions and springs": any(isinstance(one, MeanSupport) for one in model.supports),
        "loads that turn with the body, and spin": bool(model.following) or model.spin is not None,
    }
    for what, present in beside.items():
        if present:
            raise InputError(f"material: a law has a memory, beside which finite elements have no {what}")


def _refuse_contact(model: Model, k: int) -> None:
    contact = model.contacts[k]
    if any(len(bodies) > 1 for bodies in contact.groups) or contact.second is None or contact.facets is not None:
        raise InputError(f"contact {k}: of several bodies, of one with itself, or with a finite element body: not here")
    if contact.friction:
        raise InputError(f"contact {k}: friction is not on the finite element side; compare without it")
    if contact.has_inner:
        raise InputError(f"contact {k}: an inner surface is not on the finite element side")
    if contact.motion is not None:
        raise InputError(f"contact {k}: an obstacle that moves is not on the finite element side")
    if contact.obstacle is not None and not isinstance(contact.obstacle, Plane | Cylinder):
        raise InputError(f"contact {k}: a sphere or a mesh of triangles is not on the finite element side")


def _refuse_tied(model: Model, bodies: Sequence[OfBody]) -> None:
    if model.contacts:
        raise InputError("contact 0: beside ties the finite element side has none; compare without it")
    for k, tie in enumerate(model.ties):
        if tie.kind != "weld":
            raise InputError(f"tie {k}: got kind {tie.kind!r}; parts of one solid are welded, compare kind = 'weld'")
    for k, load in enumerate(model.loads):
        if isinstance(load, LineLoad):
            raise InputError(f"load {k}: a force per length is not on a rod that is meshed with others")
        if isinstance(load, Pressure) and load.follows:
            raise InputError(
                f"load {k}: a pressure that follows the surface is not on a rod that is meshed with others"
            )
        if isinstance(load, SectionLoad) and load.u is not None:
            axis = model.bodies[load.body].space.axis
            if not np.isclose(load.u, axis.breaks[[0, -1]], rtol=0.0, atol=1e-12).any():
                raise InputError(f"load {k}: a section within a rod is not loaded here; load an end, or a length")
    for body in bodies:
        if body.geometry is None:
            raise body.place.error(
                "geometry is missing: rods and bodies are meshed anew as one solid; name the STEP file of the body, "
                'geometry = "NAME.step", beside its mesh'
            )


def _refuse_loaded(model: Model, given: Mapping[str, Any]) -> None:
    """Raise `InputError` where isorod's modes are about an equilibrium: finite elements have those at rest."""
    from isorod.modal.loaded import burdens

    under = "" if given.get("at_rest") else burdens(model)
    if under:
        raise InputError(
            f"finite elements have modes at rest, and these are about the equilibrium under {under}; compare "
            "those at rest (at_rest = true), or its statics"
        )
