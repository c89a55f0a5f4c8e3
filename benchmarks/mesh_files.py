"""Time and memory of reading big mesh files: a torus as binary STL, .vtu and compressed .vtu; docs/meshes.md has the figures.

    python benchmarks/mesh_files.py [TRIANGLES]

Each file (2 000 000 triangles unless said otherwise) is loaded, welded where the format has no node numbers, and validated, in a
process of its own, whose peak memory is that of reading alone.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from pathlib import Path

import meshio
import numpy as np

READ = """
import resource, sys, time
from taichi_membrane.mesh import read_mesh
begin = time.perf_counter()
mesh = read_mesh(sys.argv[1])
seconds = time.perf_counter() - begin
assert mesh.is_closed
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
print(f"{mesh.tri_count} triangles, {mesh.node_count} nodes: {seconds:.1f} s, {peak:.2f} GiB at most")
"""


def torus(tri_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of a torus of radii 3 and 1, from a square grid of angles; normals outwards."""
    count = max(3, math.isqrt(tri_count // 2))
    along, around = np.meshgrid(*2 * (2.0 * np.pi * np.arange(count) / count,), indexing="ij")
    radius = 3.0 + np.cos(around)
    points = np.stack((radius * np.cos(along), radius * np.sin(along), np.sin(around)), axis=-1).reshape(-1, 3)
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(count), np.arange(count), indexing="ij"))
    a, b = i * count + j, (i + 1) % count * count + j
    c, d = (i + 1) % count * count + (j + 1) % count, i * count + (j + 1) % count
    return points, np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d))))


def stl(points: np.ndarray, triangles: np.ndarray) -> bytes:
    """Binary STL."""
    facets = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets["corners"] = points[triangles]
    return b"torus".ljust(80) + np.array([len(triangles)], dtype="<u4").tobytes() + facets.tobytes()


def main() -> None:
    points, triangles = torus(int(sys.argv[1]) if len(sys.argv) > 1 else 2_000_000)
    with tempfile.TemporaryDirectory() as folder:
        names = {"binary STL": "torus.stl", ".vtu, base64": "torus.vtu", ".vtu, zlib": "packed.vtu"}
        files = {kind: Path(folder) / name for kind, name in names.items()}
        files["binary STL"].write_bytes(stl(points, triangles))
        mesh = meshio.Mesh(points, [("triangle", triangles)])
        meshio.vtu.write(files[".vtu, base64"], mesh, compression=None)
        meshio.vtu.write(files[".vtu, zlib"], mesh, compression="zlib")
        for kind, path in files.items():
            done = subprocess.run([sys.executable, "-c", READ, str(path)], capture_output=True, text=True, check=True)
            print(f"{kind}, {path.stat().st_size / 1e6:.0f} MB: {done.stdout.strip()}", flush=True)


if __name__ == "__main__":
    main()
