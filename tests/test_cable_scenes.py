"""Cables of a scene in its files and on its page, and the mistakes of scenes with cables and springs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from resume_cases import run_until
from run_files import same
from test_cables import scene
from test_members import hanging, rope
from test_page import content, decode, page

import taichi_membrane as tm
from taichi_membrane.errors import InputError
from taichi_membrane.output.reader import read_run
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.members import line_elements
from taichi_membrane.simulation.model import build_mesh, build_model

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def guyed(**changes: Any) -> Scene:
    """A panel pulled at a corner by a guy to a peg, divided, and by a rope that slides over another corner."""
    return scene(
        supports=[{"group": "x_min", "hold": "xyz"}],
        anchors={"peg": [3.0, 0.0, -1.0]},
        cables={
            "rope": {"nodes": ["corner_11", "corner_10", "peg"], "EA": 5.0, "prestress": 0.4, "sliding": True},
            "guy": {"nodes": ["corner_11", "peg"], "parts": 3, "EA": 8.0, "prestress": 0.5, "mass_per_length": 0.02},
        },
        loads={"weight": {"kind": "weight", "g": 0.01}},
        fabric={"E": 100.0, "nu": 0.3, "thickness": 0.1, "mass_per_area": 1.0, "law": "none"},
        stages=[{"name": "load", "steps": 2, "loads": {"weight": 1.0}}],
        **changes,
    )  # fmt: skip


def test_files_hold_cables_as_lines_with_their_forces_and_a_stopped_run_goes_on(tmp_path: Path) -> None:
    """Lines of the vtu files in the scene's order, those that slide last; read back to the last bit, and resumed so."""
    result = tm.run(guyed(), out=tmp_path / "whole", render=False)
    assert result.converged, result.steps[-1].reason
    step = result.steps[-1]
    assert step.cable_forces.shape == (5,)
    assert step.cable_forces[3] == step.cable_forces[4]
    content = meshio.read(tmp_path / "whole/step_0001.vtu")
    assert [block.type for block in content.cells] == ["triangle", "line"]
    force, owner = content.cell_data["cable_force"], content.cell_data["cable"]
    assert np.isnan(force[0]).all()
    assert np.array_equal(force[1], step.cable_forces)
    assert owner[1].tolist() == [1, 1, 1, 0, 0]
    assert (owner[0] == -1).all()
    saved = read_run(tmp_path / "whole")
    assert all(same(one, other) for one, other in zip(saved.steps, result.steps, strict=True))
    assert saved.mesh.node_groups.keys() == result.mesh.node_groups.keys()
    run_until(0, guyed(), out=tmp_path / "part", render=False)
    resumed = tm.resume(tmp_path / "part", render=False)
    assert np.array_equal(resumed.steps[-1].displacement, step.displacement)
    assert np.array_equal(resumed.steps[-1].cable_forces, step.cable_forces)


def test_a_run_with_lines_of_its_mesh_is_read_back(tmp_path: Path) -> None:
    """Lines, and the nodes that only they use, come from the run's own files."""
    result = tm.run(rope(4), mesh=hanging(4), out=tmp_path, render=False)
    saved = read_run(tmp_path)
    assert np.array_equal(saved.mesh.points, result.mesh.points)
    assert np.array_equal(saved.mesh.node_groups["rope"], result.mesh.node_groups["rope"])
    model = build_model(saved.scene, saved.mesh)
    assert model.structure.cables is not None
    assert np.array_equal(model.structure.cables.nodes, [[4, 5], [5, 6], [6, 7], [7, 8]])
    assert same(saved.steps[0], result.steps[0])


BAD: list[tuple[dict[str, Any], str]] = [
    ({"cables": {"c": {"nodes": ["a", "b"], "EA": 1, "length": 2, "unstressed": 1}}}, "give one of unstressed .* and length"),
    ({"cables": {"c": {"along": "x_min", "EA": 1, "parts": 3}}}, "parts = 3 needs nodes"),
    ({"cables": {"c": {"along": "x_min", "EA": 1, "sliding": True}}}, "sliding = true needs nodes, three at least"),
    ({"cables": {"c": {"nodes": ["a", "b"], "EA": 1, "sliding": True}}}, "sliding = true needs nodes, three at least"),
    ({"cables": {"c": {"nodes": ["a", "b", "d"], "EA": 1, "sliding": True, "kind": "bar"}}}, "a bar does not run over"),
    ({"cables": {"c": {"nodes": ["a", "b", "d"], "EA": 1, "sliding": True, "parts": 2}}}, "nothing would hold the nodes"),
    ({"cables": {"c": {"nodes": ["a", "b", "a", "d"], "EA": 1, "sliding": True}}}, "it passes 'a' twice"),
    ({"cables": {"c": {"nodes": ["a", "b", "a"], "EA": 1, "sliding": True}}}, "it passes 'a' twice"),
    ({"anchors": {"peg": [0, 0, 5]}}, r"anchors\.peg: no cable has it among its nodes"),
    (
        {"anchors": {"p": [0, 0, 5]}, "joints": {"p": [0, 0, 6]}, "cables": {"c": {"nodes": ["p", "corner_11"], "EA": 1}}},
        r"joints\.p: anchors\.p has the name already",
    ),
    ({"anchors": {"x_max": [0, 0, 5]}, "cables": {"c": {"nodes": ["x_max", "corner_11"], "EA": 1}}}, "of that name, with 2 me"),
    ({"cables": {"x_max": {"nodes": ["corner_00", "corner_11"], "EA": 1, "parts": 2}}}, r"cables\.x_max\.parts: "),
    ({"cables": {"c": {"nodes": ["corner_00", "corner_11", "peg"], "EA": 1}}}, r"cables\.c\.nodes: no node group 'peg'"),
    ({"anchors": {"p": [1, 1, 0]}, "cables": {"c": {"nodes": ["p", "corner_11"], "EA": 1}}}, "nodes 4 and 3 lie at one place"),
    ({"probes": {"f": {"kind": "cable", "cable": "guy"}}}, r"probes\.f\.cable"),
    ({"springs": {"s": {"group": "x_max", "stiffness": 2.0}}}, "three numbers, or as one number with a direction"),
    ({"springs": {"s": {"group": "x_max", "stiffness": [0, 0, 0]}}}, r"stiffness = \[0, 0, 0\] is no spring"),
    ({"springs": {"s": {"group": "x_max", "stiffness": [1, 0, 0], "kind": "tension"}}}, "kind = 'tension' needs a direction"),
    ({"springs": {"s": {"group": "rim", "stiffness": [1, 0, 0]}}}, r"springs\.s\.group: no node group 'rim'"),
    ({"joints": {"a": [0, 0, 3], "b": [0, 0, 4]}, "cables": {"c": {"nodes": ["a", "b"], "EA": 1}}}, "to move: translation along x"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "told"), BAD)
def test_mistakes_are_told(changes: dict[str, Any], told: str) -> None:
    def read() -> None:
        one = scene(loads={}, stages=[{"name": "load"}], **changes)
        build_model(one, build_mesh(one))

    with pytest.raises((InputError, ValueError), match=told):
        read()


def test_the_page_holds_pieces_and_forces_of_cables(tmp_path: Path) -> None:
    """Nodes of each piece, the range of forces that are not zero, and anchors among supports and support forces."""
    result = tm.run(guyed(), out=tmp_path, render=False)
    head, block = content(result)
    nodes = decode(block, head["cables"]["nodes"]).reshape(-1, 2)
    assert np.array_equal(nodes, line_elements(result.scene, result.mesh)[0])
    forces = np.concatenate([step.cable_forces for step in result.steps])
    assert (head["cables"]["low"], head["cables"]["high"]) == (forces[forces > 0].min(), forces.max())
    for stored, step in zip(head["steps"], result.steps, strict=True):
        assert np.allclose(decode(block, stored["cable_force"]), step.cable_forces, rtol=1e-6)
    assert result.mesh.node_groups["peg"][0] in decode(block, head["supports"])
    assert "anchor: held in xyz" in page(result)
