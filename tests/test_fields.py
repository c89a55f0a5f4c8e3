"""The table of fields: one entry is enough for results, files, reading back and pictures; stresses say their measure."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from PIL import Image
from run_files import a_run, a_step, same
from stretched import out, pulled

import taichi_membrane as tm
from taichi_membrane import fields
from taichi_membrane.fields import Field
from taichi_membrane.mechanics.element_state import ElementState
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.output.reader import read_run
from taichi_membrane.scene import Scene
from taichi_membrane.scene.units import probe_unit
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.simulation.present import Present

E, NU, THICKNESS, WIDTH, HEIGHT = 1e3, 0.3, 0.5, 3.0, 2.0


def sheet(stretch: tuple[float, float], **changes: Any) -> Scene:
    """A sheet stretched along x and y by motions of two of its edges: the same strain in every element."""
    base = pulled(WIDTH, HEIGHT)
    return Scene.model_validate(
        base
        | {
            "name": "sheet",
            "units": {"length": "mm", "force": "N"},
            "mesh": base["mesh"] | {"along_x": 3, "along_y": 2},
            "fabric": {"E": E, "nu": NU, "thickness": THICKNESS},
            "stages": [
                {"name": "pull", "motions": out(WIDTH, HEIGHT, stretch)},
            ],
            "probes": {
                "pull": {"kind": "reaction", "group": "x_min", "component": "x"},
                "tension": {"kind": "resultant"},
                "least": {"kind": "resultant", "which": "minor", "reduce": "min"},
                "stress": {"kind": "stress"},
            },
            "solver": {"tolerance": 1e-10},
            "camera": {"size": [320, 240]},
        }
        | changes
    )  # fmt: skip


@pytest.mark.usefixtures("runtime_cpu")
@pytest.mark.parametrize("side_strain", ["green", "engineering"])
def test_resultants_are_what_a_cut_across_the_deformed_sheet_bears(side_strain: str) -> None:
    """They do the work of the support forces, for either side strain; for Green's they are t F S Fᵀ/J."""
    fabric = {"E": E, "nu": NU, "thickness": THICKNESS, "side_strain": side_strain}
    result = tm.run(sheet((1.25, 1.1), fabric=fabric))
    assert result.converged
    found = result.steps[-1].probes
    # The virtual work of a growth of all lengths by one and the same share, within and from outside.
    step = result.steps[-1]
    places = result.mesh.points + step.displacement
    corners = places[result.mesh.triangles]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    both = step.elements.major_resultant + step.elements.minor_resultant
    assert np.vdot(area, both) == pytest.approx(np.vdot(step.reaction, places), rel=1e-9)
    if side_strain == "green":
        strain = 0.5 * (np.array([1.25, 1.1]) ** 2 - 1.0)
        stress = E / (1.0 - NU**2) * (strain + NU * strain[::-1])
        assert found["tension"] == pytest.approx(-found["pull"] / (1.1 * HEIGHT), rel=1e-9)
        assert found["stress"] == pytest.approx(stress[0], rel=1e-9)
        assert found["tension"] == pytest.approx(THICKNESS * stress[0] * 1.25 / 1.1, rel=1e-9)
        assert found["least"] == pytest.approx(THICKNESS * stress[1] * 1.1 / 1.25, rel=1e-9)


def test_resultants_of_any_uniform_deformation_are_those_of_the_tensors() -> None:
    """Principal values of t F S Fᵀ/J for random F with shear and turn in space, and random S of either sign."""
    rng = np.random.default_rng(5)
    scene = sheet((1.0, 1.0))
    structure: Structure = build_model(scene, build_mesh(scene)).structure
    mesh, geometry = structure.mesh, structure.geometry
    for _ in range(20):
        gradient = np.eye(3)[:, :2] + 0.4 * rng.normal(size=(3, 2))
        piola = rng.normal(size=3)
        tensor = np.array([[piola[0], piola[2]], [piola[2], piola[1]]])
        # The fabric axes of this sheet are those of the plane, in which F is given.
        assert np.allclose(geometry.warp, [1.0, 0.0, 0.0])
        places = mesh.points[:, :2] @ gradient.T
        nothing = np.zeros(mesh.tri_count)
        state = ElementState(
            strain=np.zeros((mesh.tri_count, 3)), stress=np.tile(piola, (mesh.tri_count, 1)),
            state=nothing.astype(np.int8), fold_strain=nothing, taut_margin=nothing, slack_margin=nothing,
        )  # fmt: skip
        present = Present(
            structure=structure, displacement=places - mesh.points, reaction=np.zeros_like(mesh.points), elements=state
        )
        area = np.linalg.norm(np.cross(gradient[:, 0], gradient[:, 1]))
        cauchy = THICKNESS * gradient @ tensor @ gradient.T / area
        values = np.linalg.eigvalsh(cauchy)
        off_plane = int(np.abs(values).argmin())  # the normal bears nothing
        minor, major = np.delete(values, off_plane)
        assert present.major_resultant == pytest.approx(np.full(mesh.tri_count, major), rel=1e-9)
        assert present.minor_resultant == pytest.approx(np.full(mesh.tri_count, minor), rel=1e-9)
        # Across cuts square to the threads where they are now.
        warp, weft = (gradient[:, axis] / np.linalg.norm(gradient[:, axis]) for axis in range(2))
        side = weft - (weft @ warp) * warp
        side /= np.linalg.norm(side)
        for name, value in (
            ("warp", warp @ cauchy @ warp),
            ("weft", weft @ cauchy @ weft),
            ("shear", warp @ cauchy @ side),
        ):
            found = getattr(present, f"{name}_resultant")
            assert found == pytest.approx(np.full(mesh.tri_count, value), rel=1e-9, abs=1e-12)


EXTRA = Field(
    name="excess", place="element", meaning="excess of stress", unit="stress", measure="PK2", picture="scale",
    value=lambda present: present.major_stress - present.minor_stress,
)  # fmt: skip
PAIR = Field(
    name="sway", place="node", meaning="sway", unit="length", components=("x", "y"), split=True, picture="scale",
    value=lambda present: present.displacement[:, :2],
)  # fmt: skip


@pytest.mark.usefixtures("runtime_cpu")
@pytest.mark.parametrize("extra", [EXTRA, PAIR], ids=lambda field: field.name)
def test_an_entry_is_all_that_a_new_field_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, extra: Field) -> None:
    camera = {"size": [320, 240], "field": extra.name}
    with pytest.raises(ValueError, match=f"pictures cannot show '{extra.name}'; allowed: state, "):
        sheet((1.1, 1.0), camera=camera)
    bytes_before = fields.step_bytes(extra.place)
    monkeypatch.setattr(fields, "FIELDS", (*fields.FIELDS, extra))
    assert fields.step_bytes(extra.place) == bytes_before + 8 * (len(extra.components) or 1)
    result = tm.run(sheet((1.1, 1.0), camera=camera), out=tmp_path / "new")
    step = result.steps[-1]
    values = step.fields[extra.name]
    if extra is EXTRA:
        assert same(values, step.elements.major_stress - step.elements.minor_stress)
        assert step.elements.excess is values
    read = meshio.read(tmp_path / "new/step_0000.vtu")
    arrays = read.point_data if extra.place == "node" else {k: v[0] for k, v in read.cell_data.items()}
    parts = [values] if extra is EXTRA else list(values.T)
    assert all(same(arrays[name], part) for name, part in zip(extra.arrays, parts, strict=True))
    (saved,) = read_run(tmp_path / "new").steps
    assert same(saved, step)
    note = json.loads((tmp_path / "new/summary.json").read_text("utf-8"))["fields"][extra.name]
    assert (note["arrays"], note["unit"]) == (list(extra.arrays), "MPa" if extra is EXTRA else "mm")
    # Drawn: by its values, and not as the states are.
    monkeypatch.undo()
    tm.run(sheet((1.1, 1.0)), out=tmp_path / "states")
    pictures = [np.asarray(Image.open(tmp_path / name / "step_0000.png")) for name in ("new", "states")]
    assert (pictures[0] != pictures[1]).mean() > 0.05


def test_every_stress_says_its_measure() -> None:
    """In arrays, labels and units of probes; and no other field does."""
    units = sheet((1.0, 1.0)).units
    stressed = {
        "stress",
        "prestress",
        "major_stress",
        "minor_stress",
        "major_resultant",
        "minor_resultant",
        "warp_resultant",
        "weft_resultant",
        "shear_resultant",
        "point_major_stress",
    }
    assert {one.name for one in fields.FIELDS if one.measure} == stressed
    assert {one.name for one in fields.FIELDS if one.unit in ("stress", "fabric_stress", "resultant")} == {
        *stressed,
        "contact_pressure",
    }
    for one in fields.FIELDS:
        ends = "_pk2" if one.measure == "PK2" else "_cauchy" if one.measure else ""
        assert all(array.endswith(ends) for array in one.arrays)
    assert fields.named("major_stress").label(units) == "major stress [MPa PK2]"
    assert fields.named("major_resultant").label(units) == "major stress resultant [kN/m Cauchy]"
    scene = sheet((1.0, 1.0))
    assert [probe_unit(scene, name) for name in ("tension", "stress")] == ["kN/m Cauchy", "MPa PK2"]


def test_the_summary_tells_fields_and_units_of_probes(tmp_path: Path) -> None:
    a_run(tmp_path, [a_step(0)])
    summary = json.loads((tmp_path / "summary.json").read_text("utf-8"))
    assert summary["probes"]["peak"] == "MPa PK2"
    assert summary["fields"]["major_stress"]["measure"].startswith("PK2: second Piola–Kirchhoff")
    held = meshio.read(tmp_path / "step_0000.vtu")
    written = {*held.point_data, *held.cell_data}
    assert {array for note in summary["fields"].values() for array in note["arrays"]} <= written
