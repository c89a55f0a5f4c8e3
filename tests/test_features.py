"""Features that a scene does not use cost nothing: no field, no compiled code."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import taichi as ti
from bodies import ISOTROPIC, ORTHOTROPIC, closed_body, law

from taichi_membrane.mechanics import element, fabric
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.system import System
from taichi_membrane.solvers.relaxation import Relaxation

pytestmark = pytest.mark.usefixtures("runtime_cpu")

PLAIN: dict[str, Any] = {"tri_chamber": np.full(20, -1, dtype=np.int32)}
OPTIONAL = ("tri_fabric", "fabric_variant", "fabric_prestrain", "chamber_pressure", "tri_chamber", "node_load")
TRAPS = {
    "tension_field": fabric,
    "wrinkled_stress": fabric,
    "clipped": fabric,
    "wrinkle_direction_root": fabric,
    "pressure_corner_force": element,
    "swept_volume": element,
}
USERS: dict[str, Structure] = {
    "tension_field": closed_body(law("tension_field"), **PLAIN),
    "wrinkled_stress": closed_body(law("tension_field"), **PLAIN),
    "clipped": closed_body(law("clip"), **PLAIN),
    "wrinkle_direction_root": closed_body(ORTHOTROPIC, **PLAIN),
    "pressure_corner_force": closed_body(ISOTROPIC),
    "swept_volume": closed_body(ISOTROPIC),
}


def set_traps(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Make the named device functions fail when a kernel that calls them is compiled."""
    for name in names:

        def trap(*_: Any, name: str = name) -> None:
            raise AssertionError(f"{name} was compiled")

        monkeypatch.setattr(TRAPS[name], name, trap)


def run_everything(structure: Structure) -> System:
    """Build the engine for a structure and run each of its kernels."""
    system = System(structure)
    system.out_of_balance()
    system.potential_energy(np.zeros((12, 3)))
    system.element_state()
    Relaxation(system).compile()
    return system


def test_a_plain_scene_owns_no_field_and_compiles_no_code_of_any_feature(monkeypatch: pytest.MonkeyPatch) -> None:
    """Linear isotropic fabric without pressure, loads and prestress, with a trap in every optional device function."""
    set_traps(monkeypatch, *TRAPS)
    system = run_everything(closed_body(ISOTROPIC, **PLAIN))
    assert [name for name, _ in system.fields() if name in OPTIONAL] == []
    assert system.rigid == ()


def test_an_isotropic_tension_field_compiles_no_direction_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor the clipped law."""
    set_traps(monkeypatch, "wrinkle_direction_root", "clipped")
    run_everything(closed_body(law("tension_field"), **PLAIN))


@pytest.mark.parametrize("name", TRAPS)
def test_a_scene_that_uses_a_feature_compiles_it(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """The traps do work: the same run fails where the feature is used."""
    set_traps(monkeypatch, name)
    with pytest.raises(ti.TaichiCompilationError, match=f"{name} was compiled"):
        run_everything(USERS[name])


def test_fields_exist_exactly_where_a_feature_is_used() -> None:
    """Second fabric, second kind of element code, prestress, one and several pressures, loads."""
    two = {"fabrics": (ISOTROPIC, law("none", e_warp=2.0, e_weft=2.0, shear=2 / 2.6))}
    half = np.repeat(np.array([0, 1], dtype=np.int32), 10)
    stressed = law("none", prestress=(1.0, 0.0, 0.0))
    cases: list[tuple[set[str], dict[str, Any]]] = [
        ({"tri_fabric", "node_load"}, {**two, "tri_fabric": half, "loads": True}),
        (
            {"tri_fabric", "fabric_variant", "chamber_pressure"},
            {"fabrics": (ISOTROPIC, law("clip")), "tri_fabric": half, "tri_chamber": 0 * half},
        ),
        ({"fabric_prestrain", "chamber_pressure", "tri_chamber"}, {"fabrics": (stressed,), "tri_chamber": half - 1}),
    ]
    for expected, parts in cases:
        system = System(closed_body(ISOTROPIC, **{**PLAIN, **parts}))
        assert {name for name, _ in system.fields() if name in OPTIONAL} == expected
