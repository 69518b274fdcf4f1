"""Meshes of dolfinx and meshio (``.xdmf``): what is in a file, looked at before dolfinx, which trusts it, reads it."""

from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

from isorod.arrays import Index
from isorod.errors import InputError
from isorod.files.document import Place
from isorod.files.msh import Grid

# Kinds of cells and of facets in XDMF's words: shape, degree, nodes.
_CELLS = {
    "tetrahedron": ("tetrahedron", 1, 4),
    "tetrahedron_10": ("tetrahedron", 2, 10),
    "hexahedron": ("hexahedron", 1, 8),
    "hexahedron_27": ("hexahedron", 2, 27),
}
_FACETS = {"triangle": 3, "triangle_6": 6, "quadrilateral": 4, "quadrilateral_9": 9}

# What a file of HDF5 begins with.
_HDF = b"\x89HDF\r\n\x1a\n"


class File(NamedTuple):
    """The grids of a file.

    Attributes
    ----------
    path
        Where it is.
    hdf
        Whether numbers are in the ``.h5`` file beside it.
    cells
        Grid of the cells, their shape and the degree of their geometry; None where there is none.
    tags
        Grids of facets with numbers, and whether each has points of its own.
    """

    path: Path
    hdf: bool
    cells: tuple[str, str, int] | None
    tags: dict[str, bool]


def mesh(place: Place, value: str) -> Grid:
    """Return the mesh in a file beside the scene's, with what facets are in it."""
    file = _file(place, value)
    if file.cells is None:
        raise place.error(f"{value}: no grid of tetrahedra or hexahedra is in it")
    reader = _reader(place)
    _, shape, degree = file.cells
    try:
        points, cells = reader.mesh(file.path, file.hdf, *file.cells)
        grid = Grid(points, cells, shape, degree, {})
        return grid._replace(groups=_groups(reader, file, grid))
    except InputError as problem:
        raise place.error(f"{value}: {problem}") from None


class Facets:
    """Facets in a file of their own.

    Parameters
    ----------
    place, name
        Where it is named, and its name.
    """

    def __init__(self, place: Place, name: str) -> None:
        self._place, self._name, self._file = place, name, _file(place, name)
        if not self._file.tags:
            raise place.error(f"{name}: no grid of facets with numbers is in it")

    def on(self, grid: Grid) -> Grid:
        """Return a mesh with these facets besides its own."""
        try:
            found = _groups(_reader(self._place), self._file, grid)
            twice = sorted({*found} & {*grid.groups})
            if twice:
                raise InputError(f"group {twice[0]} is in the file of the mesh too; rename one")
        except InputError as problem:
            raise self._place.error(f"{self._name}: {problem}") from None
        return grid._replace(groups=grid.groups | found)


def _reader(place: Place) -> Any:
    """Return what reads with dolfinx (`isorod.fenics.xdmf`)."""
    try:
        from isorod.fenics import xdmf
    except ImportError as problem:
        raise place.error(
            f"finite element bodies need dolfinx, and {problem.name} is not installed (docs/installation.md)"
        ) from None
    return xdmf


def _groups(reader: Any, file: File, grid: Grid) -> dict[str, Index]:
    """Return the corners of facets by group: of each grid of facets all, and those of each number that one grid has."""
    members: dict[str, Index] = {}
    numbered: dict[str, list[Index]] = {}
    for name, own in file.tags.items():
        corners, numbers = reader.facets(file.path, file.hdf, name, own, *grid[:4])
        members[name] = corners
        for number in sorted({*numbers.tolist()}):
            numbered.setdefault(str(number), []).append(corners[numbers == number])
    for number, parts in numbered.items():
        if number in file.tags:
            raise InputError(f"{number} is the name of a grid and a number of facets; rename the grid")
        # Of several grids a number may mean as many things.
        if len(parts) == 1:
            members[number] = parts[0]
    return members


def _file(place: Place, name: str) -> File:
    """Return what is in a file, having made sure that dolfinx can read it."""
    content = place.data(name)
    try:
        found = _parsed(content, Path(name))
    except InputError as problem:
        raise place.error(f"{name}: {problem}") from None
    if found.hdf:
        # dolfinx reads that one, whatever else is named.
        data = str(Path(name).with_suffix(".h5"))
        if not place.data(data).startswith(_HDF):
            raise place.error(f"{data}: no file of HDF5")
    return found._replace(path=place.document.folder / name)


def _parsed(content: bytes, name: Path) -> File:
    if b"<!ENTITY" in content:
        raise InputError("it defines entities, which meshes have no use for")
    try:
        text = content.decode("utf-8-sig")
        # With comments, of which dolfinx would read but what is before the first.
        keeping = ElementTree.TreeBuilder(insert_comments=True, insert_pis=True)
        domain = ElementTree.fromstring(text, ElementTree.XMLParser(target=keeping)).find("./Domain")
    except (UnicodeDecodeError, ElementTree.ParseError, ValueError) as problem:
        raise InputError(f"no XDMF file: {problem}") from None
    if domain is None:
        raise InputError("no XDMF file: it has no Domain")
    cells: tuple[str, str, int] | None = None
    tags: dict[str, bool] = {}
    formats: set[str] = set()
    names: set[str] = set()
    for grid in domain.findall("Grid"):
        topology = grid.find("Topology")
        if topology is None:
            continue
        kind = topology.get("TopologyType", "").lower()
        title = grid.get("Name", "")
        if kind == "mixed":
            raise InputError(
                f"grid {title}: cells of several kinds; write those of the volume into one file, facets apart"
            )
        own = grid.find("Geometry")
        is_mesh = kind in _CELLS and own is not None and cells is None
        if not is_mesh and (kind not in _FACETS or grid.find("Attribute") is None):
            continue
        if title in names or not title or set(title) & set("'\""):
            raise InputError(f"grid {title or 'without a name'}: need a name of its own for each grid, without quotes")
        names.add(title)
        nodes = _CELLS[kind][2] if is_mesh else _FACETS[kind]
        count, form = _item(topology, title, name, nodes)
        formats.add(form)
        if own is not None:
            if own.get("GeometryType") != "XYZ":
                raise InputError(f"grid {title}: points of kind {own.get('GeometryType')}, need XYZ")
            formats.add(_item(own, title, name, 3)[1])
        if is_mesh:
            cells = title, _CELLS[kind][0], _CELLS[kind][1]
        else:
            numbers, form = _item(grid.find("Attribute"), title, name, None)
            if numbers != count:
                raise InputError(f"grid {title}: {numbers:,} numbers of {count:,} facets")
            formats.add(form)
            tags[title] = own is not None
    if len(formats) > 1:
        raise InputError("some numbers are in it and others in the .h5 file; use one format")
    return File(name, formats == {"HDF"}, cells, tags)


def _item(node: Any, grid: str, name: Path, width: int | None) -> tuple[int, str]:
    """Return how many rows, of a ``width`` or of one number, the data of a part of a grid have, and their format."""
    item = node.find("DataItem")
    what = f"grid {grid}: {node.tag}"
    if item is None or len(item):
        raise InputError(f"{what} has no DataItem of numbers alone")
    form, text = item.get("Format", ""), (item.text or "").strip()
    if form not in ("HDF", "XML"):
        raise InputError(f"{what} is in format {form!r}, need HDF or XML")
    # The second name is meshio's.
    kind = item.get("NumberType", item.get("DataType", "Int"))
    if width is None and kind not in ("Int", "UInt"):
        raise InputError(f"{what} has numbers of type {kind}, need Int")
    try:
        shape = [int(one) for one in item.get("Dimensions", "").split()]
    except ValueError:
        shape = []
    rows = shape[1:] == [width] if width else shape[1:] in ([], [1])
    if not shape or shape[0] < 1 or not rows:
        raise InputError(f"{what} has dimensions {item.get('Dimensions')!r}, need rows of {width or 1}")
    if form == "XML" and len(text.split()) != shape[0] * (width or 1):
        raise InputError(f"{what} has {len(text.split()):,} numbers, need {shape[0] * (width or 1):,}")
    if form == "HDF":
        file, _, inside = text.partition(":")
        if file != name.with_suffix(".h5").name or not inside:
            raise InputError(f"{what} is in {file:.60}, need {name.with_suffix('.h5').name}, as dolfinx names it")
    return shape[0], form
