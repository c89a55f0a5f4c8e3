"""The references themselves: published constants, independent tables and limits, none of them computed by the code under test."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taichi_membrane.assurance.verification import closed_forms
from taichi_membrane.assurance.verification.shooting import inflated_disc, pressed_between, turned_hub

PRINTED = 1e-6  # the tables below have six or seven digits


@pytest.mark.parametrize(("nu", "first"), [(0.2, 1.6827), (0.3, 1.7244), (0.4, 1.7769)])
def test_hencky_series_starts_with_the_published_coefficient(nu: float, first: float) -> None:
    # Fichter, NASA TP-3658, prints four decimals.
    assert closed_forms.hencky_series(nu)[0] == pytest.approx(first, abs=5e-5)


@pytest.mark.parametrize("wrinkled", [False, True])
def test_a_shrinking_disc_and_its_ring_agree_with_the_integrated_ring(wrinkled: bool) -> None:
    """Equilibrium (r N_r)' = N_t and compatibility of the ring, by small steps from the seam to the rim."""
    inner, nu, steps = 0.5, 0.0 if wrinkled else 0.3, 20_000
    stress, draw = closed_forms.shrink_wrinkled(inner) if wrinkled else closed_forms.shrink_fit(inner, nu)
    assert draw == pytest.approx(1.0 - (1.0 - nu) * stress, rel=1e-12)  # the disc's side of the seam
    r, h = inner, (1.0 - inner) / steps
    tension, moved = stress, -draw * inner

    def slopes(r: float, tension: float, moved: float) -> tuple[float, float]:
        hoop = 0.0 if wrinkled else moved / r + nu * tension
        return (hoop - tension) / r, tension - nu * hoop

    for _ in range(steps):
        one, along = slopes(r, tension, moved)
        two, onward = slopes(r + 0.5 * h, tension + 0.5 * h * one, moved + 0.5 * h * along)
        r, tension, moved = r + h, tension + h * two, moved + h * onward
    assert (moved if wrinkled else tension) == pytest.approx(0.0, abs=1e-8)


def test_hencky_disc_scales_with_the_cube_root_of_the_load() -> None:
    rise, stress = closed_forms.hencky_disc(1.0, 0.3)
    assert (rise, stress) == pytest.approx((0.653443, 0.431101), rel=PRINTED)
    assert closed_forms.hencky_disc(1e-6, 0.3) == pytest.approx((rise * 1e-2, stress * 1e-4), rel=1e-12)


@pytest.mark.parametrize(
    ("load", "rise", "resultant"),
    [(1e-6, 0.006534, 4.31119e-05), (1e-2, 0.141385, 2.03949e-02), (0.1, 0.309515, 0.101325)],
)
def test_disc_under_follower_pressure(load: float, rise: float, resultant: float) -> None:
    found = inflated_disc(load, 0.3, rim="held")
    # Digits of the table, which an independent finite-element code confirmed to 1e-5.
    assert found.rise == pytest.approx(rise, abs=5.1e-7)
    assert found.pole_resultant == pytest.approx(resultant, rel=5e-6)


def test_seamed_discs_tend_to_the_inextensible_balloon() -> None:
    equator, rise, volume = closed_forms.mylar_balloon()
    # 0.7627597635, 1.1981402347/2 of it, and 1.2185242161: Paulsen 1994, as elliptic integrals.
    assert (equator, rise, volume) == pytest.approx((0.7627597635, 0.5990701174 * 0.7627597635, 1.2185242161), rel=1e-9)
    found = inflated_disc(1e-6, 0.3, rim="seam")
    # The taut zone at the pole, of radius 0.06, still lifts it by 8e-5.
    assert (found.rim, found.rise, 2.0 * found.volume) == pytest.approx((equator, rise, volume), rel=1e-4)


def test_sphere_satisfies_its_own_equilibrium() -> None:
    stretch = closed_forms.sphere_stretch(1.1904762, 1.0, 1.0, 0.3)
    assert stretch == pytest.approx(1.5, rel=1e-7)
    assert 0.5 * 1.1904762 * stretch == pytest.approx((stretch**2 - 1.0) / 1.4, rel=1e-12)


def test_cylinder_by_table() -> None:
    # Independent minimisation of the potential energy: R = 25, E t = 400, p = 3.5.
    assert closed_forms.cylinder_stretches(3.5, 25.0, 400.0, 0.3) == pytest.approx(
        (1.1759157, 1.0689571), rel=PRINTED / 10
    )


@pytest.mark.parametrize(("band", "moment", "curvature"), [(0.25, 0.25, 1.777778), (0.7, 0.4, 11.11111)])
def test_strip_by_the_relation_of_stein_and_hedgepeth(band: float, moment: float, curvature: float) -> None:
    stiffness = 1e5
    kappa = 2.0 * curvature / stiffness
    force, found = closed_forms.wrinkled_strip(kappa, kappa * (0.5 - band) - 1.0 / stiffness, 1.0, stiffness)
    assert (force, found) == pytest.approx((1.0, moment), rel=PRINTED)


def test_strip_is_continuous_where_it_begins_to_wrinkle() -> None:
    below, above = (closed_forms.wrinkled_strip(2e-5 * share, 0.0, 1.0, 1e5) for share in (1 - 1e-9, 1 + 1e-9))
    assert below == pytest.approx((1.0, 1.0 / 6.0), rel=1e-8)
    assert above == pytest.approx(below, rel=1e-8)


def test_turned_hub_by_table() -> None:
    onset = 1.3 * (1.0 - 1.0 / 16.0)
    torque = turned_hub([onset * turn for turn in (1.0, 1.2, 2.0, 5.0)], 4.0, 0.3)
    # Quadrature of the straight-ray solution, confirmed by minimisation in one dimension to 1e-4.
    assert torque == pytest.approx([1.0, 1.17477, 1.68199, 3.18774], rel=5e-6)


def test_off_axis_strain_of_an_isotropic_wall_does_not_turn() -> None:
    isotropic = {"warp": 2.0, "weft": 2.0, "nu": 0.3, "shear": 2.0 / 2.6}
    found = closed_forms.off_axis_strain(0.5, 1.0, angle=0.6, **isotropic)
    assert found == pytest.approx((0.5 * (0.5 - 0.3), 0.5 * (1.0 - 0.15), 0.0), abs=1e-15)


def test_off_axis_strain_by_the_turned_compliance() -> None:
    warp, weft, nu, shear, angle = 2.0, 1.0, 0.2, 0.1, 0.5
    c, s = math.cos(angle), math.sin(angle)
    s11, s22, s12, s66 = 1 / warp, 1 / weft, -nu / warp, 1 / shear
    s16 = (2 * s11 - 2 * s12 - s66) * c**3 * s - (2 * s22 - 2 * s12 - s66) * c * s**3
    s26 = (2 * s11 - 2 * s12 - s66) * c * s**3 - (2 * s22 - 2 * s12 - s66) * c**3 * s
    found = closed_forms.off_axis_strain(0.5, 1.0, warp=warp, weft=weft, nu=nu, shear=shear, angle=angle)
    assert found[2] == pytest.approx(0.5 * s16 + s26, rel=1e-13)


def test_inflated_cantilever_is_timoshenkos_beam_without_pressure() -> None:
    found = closed_forms.inflated_cantilever(2.0, length=16.0, radius=1.0, stiffness=3.0, nu=0.0, pressure=0.0)
    assert found == pytest.approx(2.0 * 16.0**3 / (9.0 * np.pi) + 2.0 * 16.0 / (1.5 * np.pi), rel=1e-14)


@pytest.mark.parametrize(("ratio", "neck"), [(0.2, 0.97951060), (0.4, 0.91073799), (0.66, 0.59413046)])
def test_catenoid_is_the_stable_one(ratio: float, neck: float) -> None:
    assert closed_forms.catenoid_neck(ratio) == pytest.approx(neck, abs=6e-9)


@pytest.mark.parametrize(
    ("length", "stiffness", "force", "sag"),
    [(10.25, 2e4, 12.472681, 0.989632), (10.0, 100.0, 6.997640, 1.727765), (9.99, 2e4, 51.412947, 0.242939)],
)
def test_elastic_catenary_is_that_of_the_table(length: float, stiffness: float, force: float, sag: float) -> None:
    assert closed_forms.elastic_catenary(10.0, length, stiffness, 10.0) == pytest.approx((force, sag), abs=PRINTED)


def test_areas_of_minimal_surfaces() -> None:
    # Scherk: graph finite elements, extrapolated; Schwarz' D surface: 1.918893 in a cell of unit side, 2/3 of it times 2².
    assert closed_forms.scherk_area(1.0) == pytest.approx(5.69751221, rel=2e-9)
    assert closed_forms.tetrahedral_film_area() == pytest.approx(2.0 / 3.0 * 1.918893 * 4.0, rel=PRINTED)


@pytest.mark.parametrize("head", [0.1, 1.0, 5.0])
def test_a_filled_tube_is_in_balance(head: float) -> None:
    """Of half a section, integrated by small steps from the crown: it closes on the ground, and its weight rests on the contact."""
    height, tension, width = closed_forms.filled_tube(head)
    crown, steps = head * height, 20_000
    side = 0.5 * (1.0 - width)
    x = z = angle = area = 0.0
    for _ in range(steps):
        turn = (crown + z) / tension * side / steps
        middle = angle + 0.5 * turn
        x += np.cos(middle) * side / steps
        fall = np.sin(middle) * side / steps
        area += (x - 0.5 * np.cos(middle) * side / steps) * fall
        z, angle = z + fall, angle + (crown + z + 0.5 * fall) / tension * side / steps
    assert angle == pytest.approx(np.pi, rel=1e-4)
    assert z == pytest.approx(height, rel=1e-4)
    assert x == pytest.approx(0.5 * width, rel=1e-3)
    assert 2.0 * area == pytest.approx(width * (crown + height), rel=1e-3)


def test_a_sphere_that_plates_just_touch_is_the_free_one() -> None:
    """And one that they press has the tension at the equator that carries half of the pressure less their force."""
    load, nu = 0.3, 0.3
    stretch = closed_forms.sphere_stretch(load, 1.0, 1.0, nu)
    free = pressed_between(load, nu, 2.0 * stretch * (1.0 - 1e-5))
    assert free.radius == pytest.approx(stretch, rel=1e-4)
    assert free.volume == pytest.approx(4.0 / 3.0 * np.pi * stretch**3, rel=1e-4)
    assert free.force < 1e-3
    pressed = pressed_between(load, nu, 1.8)
    less = pressed_between(load * (1.0 + 1e-4), nu, 1.8)
    # Work of a change of the gap: dV/dh at a given pressure is the plate's force over it, by reciprocity with dF/dp.
    wider = pressed_between(load, nu, 1.8 + 1e-4)
    assert (wider.volume - pressed.volume) / 1e-4 == pytest.approx(
        (less.force - pressed.force) / (load * 1e-4), rel=2e-3
    )
