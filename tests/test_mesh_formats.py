"""Every case of the table of mesh formats: read with the right counts, area and groups, or refused with the right words."""

from __future__ import annotations

from pathlib import Path

import pytest
from mesh_cases import CASES, Case, Read

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh, read_mesh


def sizes(groups: object) -> dict[str, int]:
    return {name: len(members) for name, members in dict(groups).items()}  # type: ignore[call-overload]


def assert_is(mesh: Mesh, wanted: Read) -> None:
    """Counts and area agree; all named groups are there, with their sizes; no group of triangles or lines is there besides."""
    assert (mesh.tri_count, mesh.node_count, len(mesh.lines)) == (wanted.triangles, wanted.nodes, wanted.lines)
    assert float(mesh.tri_areas().sum()) == pytest.approx(wanted.area, rel=1e-12)
    assert wanted.tri_groups.items() <= sizes(mesh.tri_groups).items()
    assert wanted.node_groups.items() <= sizes(mesh.node_groups).items()
    assert sizes(mesh.line_groups) == wanted.line_groups
    assert sizes(mesh.loose_groups) == wanted.loose_groups
    for words in wanted.notes:
        assert any(words in note for note in mesh.notes), mesh.notes
    if not wanted.notes:
        assert [note for note in mesh.notes if "holds only" not in note] == []


@pytest.mark.parametrize("case", CASES, ids=[f"{case.format.split()[0]}: {case.feature}" for case in CASES])
def test_a_file_is_read_right_or_refused_in_one_sentence(tmp_path: Path, case: Case) -> None:
    path = case.write(tmp_path)
    if isinstance(case.verdict, Read):
        assert_is(read_mesh(path), case.verdict)
        return
    with pytest.raises(InputError, match=case.verdict) as caught:
        read_mesh(path)
    assert str(caught.value).startswith(f"{tmp_path}")
    assert "cannot be read, the file may be damaged" not in str(caught.value), (
        "a reader failed where it should have said why"
    )
    assert "\n" not in str(caught.value)


def test_the_page_of_formats_is_made_from_this_table() -> None:
    from mesh_cases.page import PAGE, page

    assert PAGE.read_text(encoding="utf-8") == page(), "run PYTHONPATH=tests python -m mesh_cases"
