"""The order of the rooms: an import leads from a later folder of isorod to an earlier one, never back."""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
HOUSE = ROOT / "src" / "isorod"

# From the ground up; what stands before them is a file of its own.
ROOMS = [
    *"geometry material petsc fenics space model contact assembly output checks dynamics statics modal".split(),
    *"buckling harmonic random scenes files design command".split(),
]
GROUND = ["errors", "arrays", "tensors", "keeping", "compiling", "compiled", "options", "memory", "choices"]
# What ``python -m isorod`` runs, and what ``import isorod`` offers: they stand on the ground and lead to the top.
DOORS = ("__init__", "__main__")
FOREIGN = {"dolfinx", "ufl", "basix", "ffcx", "gmsh", "pyvista", "vtk", "cosseratbench", "comparisons", "meshes"}


def files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.py"))


def name_of(file: Path, root: Path) -> str:
    return ".".join(file.relative_to(root).with_suffix("").parts).removesuffix(".__init__")


@cache
def imports(file: Path, nested: bool = True) -> frozenset[str]:
    """Return the modules a file imports, those for type checking and within functions (if nested) too."""
    tree = ast.parse(file.read_text())
    found = set()
    for node in ast.walk(tree) if nested else tree.body:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            # What is imported from a package may be a module of it.
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


def room(module: str) -> str | None:
    """Return the folder of a module of isorod, None on the ground."""
    parts = module.split(".")
    return parts[1] if parts[0] == "isorod" and len(parts) > 1 and parts[1] in ROOMS else None


def test_every_file_is_in_a_room_or_on_the_ground():
    for file in files(HOUSE):
        place = file.relative_to(HOUSE).parts
        assert place[0] in ROOMS if len(place) > 1 else file.stem in [*GROUND, *DOORS], file


@pytest.mark.parametrize("own", [None, *ROOMS])
def test_no_import_leads_to_a_later_room(own):
    for file in files(HOUSE / own) if own else (file for file in HOUSE.glob("*.py") if file.stem not in DOORS):
        for module in imports(file):
            other = room(module)
            if other is not None:
                assert own is not None and ROOMS.index(other) <= ROOMS.index(own), f"{file} imports {module}"


@pytest.mark.parametrize("package", ["src/isorod", "comparisons", "meshes"])
def test_no_files_import_each_other_in_a_circle(package):
    root = ROOT / Path(package).parent
    modules = {name_of(file, root): file for file in files(ROOT / package) if file.name != "__init__.py"}
    above: dict[str, set[str]] = {name: {m for m in imports(file) if m in modules} for name, file in modules.items()}
    assert any(above.values())
    while above:
        ground = {name for name, below in above.items() if not below & above.keys()}
        assert ground, f"circle among {sorted(above)}"
        above = {name: below for name, below in above.items() if name not in ground}


def test_the_rod_knows_no_finite_elements_nor_pictures():
    """pyvista and vtk are loaded where a file is written or a picture drawn; the studies never.

    gmsh is known in one file, which reads wires of STEP files.

    dolfinx is known in one room, which the others enter where a scene has a finite element body.
    """
    late = FOREIGN - {"pyvista", "vtk"}
    for file in files(HOUSE):
        if file.is_relative_to(HOUSE / "fenics"):
            assert {module.split(".")[0] for module in imports(file)} & FOREIGN <= {"dolfinx", "ufl", "basix"}, file
            continue
        assert not {module.split(".")[0] for module in imports(file, nested=False)} & FOREIGN, file
        assert "fenics" not in {room(module) for module in imports(file, nested=False)}, file
        kernel = {"gmsh"} if file == HOUSE / "files" / "wires.py" else set()
        assert {module.split(".")[0] for module in imports(file)} & late == kernel, file
    for file in files(ROOT / "meshes"):
        assert "comparisons" not in {module.split(".")[0] for module in imports(file)}, file


def test_kernels_are_compiled():
    """A file that ends in ``_kernel`` holds compiled functions alone, besides the types they take."""
    kernels = [
        file for package in ("src", "comparisons") for file in files(ROOT / package) if file.stem.endswith("_kernel")
    ]
    assert len(kernels) >= 10
    for file in kernels:
        for node in ast.parse(file.read_text()).body:
            if isinstance(node, ast.FunctionDef):
                assert any("njit" in ast.unparse(one) for one in node.decorator_list), f"{file}: {node.name}"


def test_no_file_holds_two_ideas():
    for package in ("src", "comparisons", "meshes", "tests"):
        for file in files(ROOT / package):
            assert len(file.read_text().splitlines()) <= 400, file
