"""The page docs/meshes.md, made from the table of cases by reading each file."""

from __future__ import annotations

import tempfile
from itertools import groupby
from pathlib import Path

from mesh_cases import CASES, Case, Read
from taichi_membrane.errors import InputError
from taichi_membrane.mesh import read_mesh
from taichi_membrane.mesh.read import MESHIO, READERS

PAGE = Path(__file__).resolve().parent.parent.parent / "docs" / "meshes.md"
HEAD = """# Mesh files: what is carried over

Made from the table that the tests check (`tests/mesh_cases`), by `PYTHONPATH=tests python -m mesh_cases`; do not edit.

A mesh is triangles, with named groups of elements and of nodes; line elements with named groups (`mesh.lines`, `mesh.line_groups`);
and points that no triangle uses but a group or a line does (`mesh.loose_points`, `mesh.loose_groups`). A group of elements also
names its nodes; where points, lines and triangles have groups of one name, the node group of that name is of the lowest kind. What
a file says besides is named in `mesh.notes` (`taichi-membrane check` and `run` print them, a run's `summary.json` keeps them), or
the file is refused with one message and exit code 2. A group that the scene does not use is never a reason to refuse a file.

- **Quadrilaterals** of every format are always split in two, along the shorter diagonal that lies inside; a note says how many.
  **Second-order and solid elements** are refused by name.
- **Nodes** keep their order in the file, without those that nothing uses; **elements** keep theirs, a quadrilateral being two in
  its place. Messages name elements and nodes by their numbers in the mesh, from 0, and then as the file calls them.
- **Cracks**: free edges that lie on each other, or nearly, are refused with their number and largest gap, and so are nodes on a
  free edge. `--repair` joins those within the tolerance, which `check` prints: {digits:g} times the last digit of the coordinates
  (single precision and rounded text are told from the numbers), at least {same:g} of the mesh's size, at most {nearly:g} of the
  shortest edge. Gaps up to that share of the shortest edge are refused whatever the digits are; `join = 1e-4` in the scene's mesh
  makes `--repair` join them. `open_seams = true` keeps all such edges apart, as slits.
- **Element data**: real numbers and vectors of the elements in `.vtk`, `.vtu`, `.vtp`, `.msh` ($ElementData) and what meshio reads
  keep their names (`mesh.tri_fields`); scenes take thickness, prestress, warp directions and pressure coefficients from them by
  `{{ field = "NAME" }}`. An array of whole numbers is groups, one for each value: so a number for each fabric becomes
  `[fabrics.NAME_3]`. Arrays of vectors named `warp` are the mesh's own warp directions.
- **Counts** in the file are compared with what is there; reading is bounded in memory and time. Two million triangles are loaded,
  welded and validated in 9.0 s and 0.92 GiB from binary STL, in 6.4 s and 0.70 GiB from `.vtu`, in 5.4 s from compressed `.vtu`
  (one thread of an AMD EPYC; `benchmarks/mesh_files.py`).
- **Writing**: `mesh.save("file.vtu")` keeps everything; `.inp` and `.msh` all but warp directions and element data; `.stl` bare
  surfaces, in single precision.
- **Text** may be UTF-8, UTF-16 with its mark, or any 8-bit encoding (read as Latin-1).

File extensions: {own}.
Through meshio, with its sets and whole-number arrays as groups: {plain}; with a package more
(`pip install 'taichi-membrane[mesh]'`): {extra}.
`.3dm` needs rhino3dm: meshes of the model; layers and object names as groups. `.cgns` needs h5py: one unstructured zone; sections
and boundary conditions as groups. `.e`, `.ex2`, `.exo` (Exodus) need netCDF4: element blocks and node sets as groups; side sets are
named in a note. What meshio says of a file it reads is a note too.

"""


def page() -> str:
    """The page's text."""
    from taichi_membrane.mesh import cracks

    head = HEAD.format(
        digits=cracks._DIGITS,
        same=cracks.SAME_PLACE,
        nearly=cracks.NEARLY,
        own=", ".join(sorted(READERS)),
        plain=", ".join(sorted(name for name, package in MESHIO.items() if not package)),
        extra=", ".join(f"{name} ({package})" for name, package in sorted(MESHIO.items()) if package),
    )
    tables = []
    with tempfile.TemporaryDirectory() as folder:
        for name, cases in groupby(CASES, key=lambda case: case.format):
            rows = [_row(case, Path(folder) / f"{number}") for number, case in enumerate(cases)]
            title = "All formats" if name == "any" else name
            tables.append(f"## {title}\n\n| what the file says | what becomes of it |\n| --- | --- |\n" + "".join(rows))
    return head + "\n".join(tables)


def _row(case: Case, folder: Path) -> str:
    folder.mkdir(exist_ok=True)
    try:
        found = _told(case.verdict) if isinstance(case.verdict, Read) else "read"
        notes = read_mesh(case.write(folder)).notes
        found += "".join(f"; says “{note}”" for note in notes)
    except InputError as error:
        found = f"refused: “{str(error).removeprefix(f'{folder / case.name}: ')}”"
    cells = [text.replace(str(folder), "…").replace("|", "\\|").replace("*", "\\*") for text in (case.feature, found)]
    return f"| {cells[0]} | {cells[1]} |\n"


def _told(wanted: Read) -> str:
    """Groups of a mesh that is read."""
    kinds = (("elements", wanted.tri_groups), ("nodes", wanted.node_groups), ("lines", wanted.line_groups))
    groups = [
        f"{kind} {', '.join(f'`{name}` ({size})' for name, size in held.items())}" for kind, held in kinds if held
    ]
    groups += [f"element data {', '.join(f'`{name}`' for name in wanted.tri_fields)}"] if wanted.tri_fields else []
    groups += [f"loose points {', '.join(f'`{name}`' for name in wanted.loose_groups)}"] if wanted.loose_groups else []
    return "read" + (f": {'; '.join(groups)}" if groups else "")
