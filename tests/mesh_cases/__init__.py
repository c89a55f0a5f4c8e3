"""What each mesh format carries over: files with the right answer, from which tests and docs/meshes.md are made."""

from __future__ import annotations

from mesh_cases.abaqus_cases import ABAQUS
from mesh_cases.common import Case, Read
from mesh_cases.gmsh_cases import GMSH
from mesh_cases.model_cases import DYNA, KRATOS, MEDIT
from mesh_cases.nastran_cases import NASTRAN
from mesh_cases.other_cases import ANY, DXF
from mesh_cases.surface_cases import OBJ, OFF, PLY, STL
from mesh_cases.vtk_cases import VTK

CASES = [*ABAQUS, *NASTRAN, *GMSH, *STL, *OBJ, *PLY, *OFF, *VTK, *MEDIT, *KRATOS, *DYNA, *DXF, *ANY]

__all__ = ["CASES", "Case", "Read"]
