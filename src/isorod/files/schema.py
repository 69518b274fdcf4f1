"""The words of a scene file, and the function or class of this package that each calls.

A new curve, section, law, support, load, obstacle or measure is one more line here; its keys, their kinds and defaults
are those of its signature, what they mean is in its docstring.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from isorod.files.angles import ANGLES, DEGREES, RADIANS
from isorod.files.data import BOND, HISTORY, POINTS, VARYING
from isorod.files.document import Place
from isorod.files.form import CONTACT, GROUP, LOAD, OBSTACLE, PARTNER, ROD, SUPPORT, SURFACE, TIE, Form, several, table
from isorod.files.material import BULK, CONSTANTS, FIBRE, LIBRARY, VARIABLES
from isorod.files.meshes import FACETS, GEOMETRY, MESH
from isorod.files.values import Kind
from isorod.files.vibrations import DAMPING, FREQUENCIES, PSD
from isorod.files.vibrations import LOADS as SEVERAL_LOADS
from isorod.files.warmth import EXPANSION, TEMPERATURE

_WINDING = {"radius": VARYING, "pitch": VARYING}
# Pieces of a curve that is a chain of them.
PIECES = {
    "straight": Form("isorod.geometry.chain:Straight"),
    "arc": Form("isorod.geometry.chain:Arc"),
    "helix": Form("isorod.geometry.chain:Helix", kinds=_WINDING),
}
CURVES = {
    "straight": Form("isorod.geometry.center_line:straight"),
    "arc": Form("isorod.geometry.coils:arc"),
    "helix": Form("isorod.geometry.coils:helix", kinds=_WINDING),
    "chain": Form("isorod.geometry.chain:chain", kinds={"pieces": several(PIECES, "pieces in a list")}),
    "polyline": Form("isorod.geometry.center_line:polyline", kinds={"points": POINTS}),
    "nurbs": Form("isorod.files.curves:nurbs", kinds={"points": POINTS}),
}
SECTIONS = {
    "circle": Form("isorod.geometry.section:circle", defaults={"n": 8}),
    "ellipse": Form("isorod.geometry.section:ellipse", defaults={"n": 8}),
    "flower": Form("isorod.geometry.section:flower"),
    "airfoil": Form("isorod.geometry.section:airfoil"),
    "naca": Form("isorod.geometry.section:naca"),
    "rounded_rectangle": Form("isorod.geometry.section:rounded_rectangle", defaults={"n": None}),
    "outline": Form("isorod.geometry.section:from_file"),
    "points": Form("isorod.geometry.section:from_points"),
}
LAWS = {
    "LinearElastic": Form("isorod.material.linear_elastic:LinearElastic"),
    "NeoHookean": Form("isorod.material.neo_hookean:NeoHookean"),
    "StVenantKirchhoff": Form("isorod.material.st_venant_kirchhoff:StVenantKirchhoff"),
    "Orthotropic": Form("isorod.material.orthotropic:Orthotropic", kinds={"axes": FIBRE}),
    "OrthotropicKirchhoff": Form("isorod.material.orthotropic_kirchhoff:OrthotropicKirchhoff", kinds={"axes": FIBRE}),
    "TransverselyIsotropic": Form("isorod.material.orthotropic:TransverselyIsotropic", kinds={"fibre": FIBRE}),
    "MooneyRivlin": Form("isorod.material.mooney_rivlin:MooneyRivlin", kinds={"bulk": BULK}),
    "Yeoh": Form("isorod.material.yeoh:Yeoh", kinds={"bulk": BULK}),
    "Gent": Form("isorod.material.gent:Gent", kinds={"bulk": BULK}),
    "Ogden": Form("isorod.material.ogden:Ogden", kinds={"bulk": BULK}),
    "HolzapfelGasserOgden": Form(
        "isorod.material.holzapfel_gasser_ogden:HolzapfelGasserOgden", kinds={"bulk": BULK, "fibre": FIBRE}
    ),
    "Hyperelastic": Form(
        "isorod.files.material:hyperelastic", kinds={"constants": CONSTANTS, "bulk": BULK, "fibre": FIBRE}
    ),
    "Plastic": Form("isorod.material.plastic:Plastic"),
    "Viscoplastic": Form("isorod.material.plastic:Viscoplastic"),
    "Creep": Form("isorod.material.viscous:Creep"),
    "Viscoelastic": Form("isorod.material.viscous:Viscoelastic"),
    "Dissipative": Form(
        "isorod.files.material:dissipative", kinds={"constants": CONSTANTS, "bulk": BULK, "state": VARIABLES}
    ),
    "UserMaterial": Form("isorod.material.user:library", kinds={"path": LIBRARY}),
    "Muscle": Form("isorod.material.muscle:Muscle", kinds={"fibre": FIBRE}),
    "ActiveMuscle": Form("isorod.files.material:active_muscle", kinds={"curve": POINTS, "fibre": FIBRE}),
}
# What else a rod has: keys of its own, and those of its space.
SWEEP = Form(
    "isorod.geometry.center_line:CenterLine.sweep",
    kinds={"end": SECTIONS},
    keys={"end": "end_section", "tolerance": "section_tolerance"},
    left=("section",),
)
RINGS = Form("isorod.geometry.rod:Rod.with_rings")
THERMAL = Form(
    "isorod.material.thermal:Thermal",
    kinds={"expansion": EXPANSION, "temperature": TEMPERATURE, "history": HISTORY},
    keys={"history": "temperature_history"},
    left=("law",),
)
COPIES = Form("isorod.files.copies:copies")
TREE = Form("isorod.files.trees:tree", left=("content",))
BODY = Form("isorod.model.body:Body", left=("space", "material"))
SPACE = Form("isorod.space.space:Space", left=("rod", "section_basis"))


def _on_rod(target: str, main: str | None = None) -> Form:
    kinds, keys = {"body": ROD, "history": HISTORY}, {"body": "rod", "which": "end", "at": "place"}
    return Form(target, main, kinds=kinds, keys=keys, left=("space",))


def _support(target: str) -> Form:
    # Angles of a file are in degrees; what was in radians is read until the next release.
    form = _on_rod(target)
    kinds, keys = {**form.kinds, "turn": DEGREES}, {**form.keys, "turn": "rotation"}
    return replace(form, kinds=kinds, keys=keys, more={"turn": RADIANS})


SUPPORTS = {
    "end": _support("isorod.files.supports:end"),
    "patch": _support("isorod.model.support:Support.patch"),
    "section": _on_rod("isorod.model.mean:MeanSupport.section", main="u"),
    "bearing": _on_rod("isorod.model.mean:MeanSupport.bearing", main="u"),
    "spring": _on_rod("isorod.model.mean:MeanSupport.spring"),
    "rigid": _on_rod("isorod.model.mean:MeanSupport.rigid", main="rod"),
}
LOADS = {
    "end": _on_rod("isorod.model.load:SectionLoad.end"),
    "section": _on_rod("isorod.model.load:SectionLoad", main="u"),
    "pressure": _on_rod("isorod.model.load:Pressure"),
    "body_force": _on_rod("isorod.model.load:BodyForce"),
    "per_length": _on_rod("isorod.model.load:LineLoad"),
    "at": _on_rod("isorod.model.load:PointLoad"),
}


def _on_group(name: str, **more: Any) -> Form:
    return Form(f"isorod.files.solid:{name}", kinds={"group": GROUP} | more)


# Of finite element bodies what else they have, what holds and what loads them.
SOLID = Form("isorod.files.solid:solid", kinds={"mesh": MESH, "facets": FACETS, "geometry": GEOMETRY})
HELD = _on_group("held")
SOLID_LOADS = {name: _on_group(name) for name in ("force", "traction", "pressure", "body_force")}
GRAVITY = Form("isorod.model.load:Weight", kinds={"history": HISTORY}, left=("of", "body"))
SPIN = Form("isorod.model.load:Spin", kinds={"history": HISTORY})
MOTION = Form("isorod.model.moving:ObstacleMotion", kinds={"angle": ANGLES})


def _obstacle(target: str) -> Form:
    return Form(target, kinds={"motion": table(MOTION, "a table: move, angle, axis, center")})


OBSTACLES = {
    "Plane": _obstacle("isorod.model.contact:Plane"),
    "Cylinder": _obstacle("isorod.model.contact:Cylinder"),
    "Sphere": _obstacle("isorod.model.contact:Sphere"),
    "TriangleMesh": _obstacle("isorod.model.triangle_mesh:TriangleMesh.from_file"),
}
CONTACTS = Form("isorod.model.contact:Contact", kinds={"first": ROD, "second": PARTNER})
TIES = Form("isorod.files.ties:tie", kinds={"slave": SURFACE, "master": SURFACE, "bond": BOND})

# What a file does not say: PETSc's options, too, are for the command line alone, as they name code that is run.
_RUN = tuple(
    "model comm petsc state displacement velocity checkpoint every resume progress start keep solids like".split()
)
_SWING = {"damping": DAMPING, "loads": SEVERAL_LOADS}
ANALYSES = {
    "statics": Form("isorod.statics:solve", left=_RUN),
    "modal": Form("isorod.modal:solve", left=_RUN),
    "buckling": Form("isorod.buckling:solve", left=_RUN),
    "harmonic": Form("isorod.harmonic:solve", left=_RUN, kinds={"frequencies": FREQUENCIES} | _SWING),
    "random": Form("isorod.random:solve", left=_RUN, kinds={"psd": PSD} | _SWING),
    "dynamics": Form("isorod.dynamics:solve", left=_RUN),
    "geometry": Form("isorod.files.measures:geometry"),
}
# Those of amplitudes, and of each that measures something the class of its solutions.
SWINGING = ("harmonic", "random")
SOLUTIONS = {"statics": "Equilibrium", "modal": "Modes", "dynamics": "History"} | dict.fromkeys(SWINGING, "Response")


def analysis(place: Place, value: Any) -> tuple[str, bool]:
    """Return the word of the analysis that a file asks for, and whether it is of explicit steps."""
    if isinstance(value, str):
        if value not in ANALYSES:
            raise place.unknown(value, ANALYSES)
        return value, value == "dynamics"
    strange = next((word for word in place.table(value) if word not in ANALYSES), None)
    if strange is not None:
        raise (place / strange).unknown_key(ANALYSES)
    if len(value) != 1:
        raise place.error(f"need one of {', '.join(ANALYSES)}")
    ((word, keys),) = value.items()
    return word, word == "dynamics" and not (isinstance(keys, dict) and keys.get("integrator") == "implicit")


def _measure(name: str, **kinds: Kind) -> Form:
    # The unit is a word for people.
    target = name if ":" in name else f"measures:{name}"
    return Form(f"isorod.files.{target}", kinds=kinds, left=("solution",), more={"unit": str})


MEASURES = {
    "reaction": _measure("reaction", support=SUPPORT),
    "moment": _measure("moment", support=SUPPORT),
    "displacement": _measure("displacement", rod=ROD),
    "acceleration": _measure("vibrations:acceleration", rod=ROD),
    "rotation": _measure("rotation", rod=ROD),
    "stress": _measure("stress", rod=ROD),
    "section_force": _measure("section_force", rod=ROD),
    "energy": _measure("energy", rod=ROD),
    "state": _measure("remembered:state", rod=ROD),
    "dissipated": _measure("remembered:dissipated", rod=ROD),
    "stiffness": _measure("stiffness", support=SUPPORT),
    "frequency": _measure("frequency", rod=ROD),
    "frequency_like": _measure("frequency_like", load=LOAD),
    "contact_force": _measure("contacts:contact_force", contact=CONTACT),
    "contact_moment": _measure("contacts:contact_moment", contact=CONTACT),
    "contact_patch": _measure("contacts:contact_patch", contact=CONTACT),
    "obstacle_force": _measure("contacts:obstacle_force", obstacle=OBSTACLE),
    "obstacle_moment": _measure("contacts:obstacle_moment", obstacle=OBSTACLE),
    "tie_force": _measure("tie_force", tie=TIE),
    "tie_moment": _measure("tie_moment", tie=TIE),
}

# Measures of the state of any load step.
ALONG = (
    *("reaction", "moment", "displacement", "rotation", "stress", "section_force", "energy"),
    *("state", "dissipated"),
    *("obstacle_force", "obstacle_moment"),
)


def refuse_unavailable(place: Place, table: Mapping[str, Any], analysis: str, available: Mapping[str, Form]) -> None:
    """Raise `InputError` where a table asks for what is not available in an analysis, but in others."""
    words = [word for word in table if word in MEASURES]
    if words and not available.keys() & {*words}:
        raise (place / words[0]).error(f"not available in {analysis}; available: {', '.join(available)}")


# What a record has besides what is measured.
RESERVED = frozenset(
    "scene options data case analysis dofs unknowns quadrature discretisation built seconds solver ranks versions "
    "names commit machine time files settings petsc_options error_estimate estimate_seconds refinements "
    "newton_iterations "
    "linear_iterations load_steps cuts residual_norms pressures contacts ties solids contact_area penetration "
    "augmentations residuals rigid below shift iterations frequencies times reactions tie_forces tie_moments "
    "contact_force contact_forces kinetic stored contact_energy added_kinetic muscle_work load_work dissipated "
    "energy_error momentum_error steps time_step critical_step microseconds_a_step resumed integrator "
    "added_kinetic_share "
    "smallest_jacobian volume control_points stabilisation stabilisation_rounds about falling places "
    "stress_error_estimate negative_eigenvalues deviation time_error factors linear settled equilibria largest "
    "critical_load critical_loads obstacle_forces obstacle_moments end_time response peaks apparent resonances ratios "
    "left_out derivatives no_derivatives differences".split()
)
