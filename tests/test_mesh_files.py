"""Small files that other programs read wrong: each stands for a kind of fault, and has known counts, areas and groups."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import read_mesh

FOLDER = Path(__file__).resolve().parent / "mesh_files"
CASES: dict[str, dict[str, list[int] | range]] = {
    "a_elset2nd.inp": {"top": range(4, 8)},
    "a_elsetmid.inp": {"bottom": range(4), "top": range(4, 8)},
    "b_elsetfirst.inp": {"bag": range(8)},
    "a_sameelset.inp": {"bag": [0, 1, 2, 3, 4, 5, 7], "patch": [6]},
    "a_rp.inp": {"bag": range(8)},
    "a_lower.inp": {"bag": range(8)},
    "a_m3d3.inp": {"bag": range(8)},
    "n_mixlarge.bdf": {"pid_10": range(8)},
    "n_nobegin.nas": {"pid_10": range(4), "pid_20": range(4, 8)},
    "o_neg.obj": {},
    "off_tab.off": {},
    "p_idx.ply": {},
}


@pytest.mark.parametrize("name", CASES)
def test_a_sheet_of_eight_triangles(name: str) -> None:
    mesh = read_mesh(FOLDER / name)
    assert (mesh.node_count, mesh.tri_count) == (9, 8)
    assert float(mesh.tri_areas().sum()) == pytest.approx(4.0, rel=1e-12)
    for group, members in CASES[name].items():
        assert mesh.tri_groups[group].tolist() == list(members)


def test_a_point_of_a_set_that_no_element_uses_is_told() -> None:
    mesh = read_mesh(FOLDER / "a_rp.inp")
    assert list(mesh.loose_groups) == ["RP"]
    assert any("'RP' holds only 1 point that no triangle uses" in note for note in mesh.notes)


def test_parts_with_equal_numbers_stay_apart() -> None:
    mesh = read_mesh(FOLDER / "a_parts2.inp")
    areas = sorted(float(mesh.tri_areas()[members].sum()) for n, members in mesh.tri_groups.items() if n != "all")
    assert areas == pytest.approx([2.0, 8.0])
    assert mesh.tri_count == 8


def test_instances_lie_where_they_are_put() -> None:
    mesh = read_mesh(FOLDER / "a_instmove.inp")
    assert mesh.tri_count == 16
    heights = {n: set(mesh.points[mesh.triangles[m], 2].ravel().tolist()) for n, m in mesh.tri_groups.items()}
    assert sorted(map(tuple, heights.values()), key=str) == sorted([(5.0,), (-5.0,), tuple({5.0, -5.0})], key=str)


def test_a_cylinder_given_in_its_own_coordinates() -> None:
    mesh = read_mesh(FOLDER / "n_cyl.bdf")
    assert np.hypot(*mesh.points[:, :2].T) == pytest.approx(np.ones(mesh.node_count), rel=1e-12)
    assert float(mesh.tri_areas().sum()) == pytest.approx(8.0 * np.sin(np.pi / 8.0), rel=1e-12)  # four chords over 45°


@pytest.mark.parametrize(
    ("name", "triangles", "lines", "nodes"),
    [
        ("g_samename_2.2.msh", {"west": 14, "east": 14}, {"west": 2, "right": 2}, {"west": 3, "east": 12}),
        ("g_unnamed_2.2.msh", {"physical_1": 14, "physical_2": 14}, {"physical_11": 2, "physical_12": 2}, {}),
        ("g_overlap_2.2.msh", {"west": 14, "east": 14, "fabric": 28}, {"left": 2, "held": 4}, {"left": 3, "held": 6}),
    ],
)
def test_physical_groups(name: str, triangles: dict[str, int], lines: dict[str, int], nodes: dict[str, int]) -> None:
    mesh = read_mesh(FOLDER / name)
    assert (mesh.tri_count, float(mesh.tri_areas().sum())) == (28, pytest.approx(2.0))
    assert {n: len(m) for n, m in mesh.tri_groups.items() if n != "all"} == triangles
    assert {n: len(m) for n, m in mesh.line_groups.items()} == lines
    assert nodes.items() <= {n: len(m) for n, m in mesh.node_groups.items()}.items()


def test_a_sphere_in_two_patches_whose_seam_differs_by_the_last_digit() -> None:
    with pytest.raises(InputError, match=r"32 pairs of free edges coincide or nearly do, .* largest gap 8.53e-06"):
        read_mesh(FOLDER / "s_ulp.stl")
    mesh = read_mesh(FOLDER / "s_ulp.stl", repair=True)
    assert mesh.is_closed
    assert (mesh.node_count, mesh.tri_count) == (258, 512)
    assert "32 pairs of free edges" in mesh.mended[0]
