"""The three wrinkling laws at a point, against the brute-force oracle and against the laws' own definitions."""
# No deferred annotations here: Taichi reads the annotations of the kernels below, which mypy cannot.
# mypy: disable-error-code="valid-type, no-untyped-def"

from functools import cache
from typing import Any

import numpy as np
import oracle
import pytest
import taichi as ti
from oracle import SLACK, TAUT, WRINKLED, Floats

from taichi_membrane.mechanics import fabric
from taichi_membrane.mechanics.preparation import FabricConstants

pytestmark = pytest.mark.usefixtures("runtime_cpu")

SEEDS = [1, 2, 3]
STATES = [TAUT, WRINKLED, SLACK]
COUNT = 300
EPS = np.finfo(np.float64).eps
# ν reaches 95 % of its limit, where the stiffness is 1/(1 - 0.95²) = 10 times the moduli; a few operations each round.
# Errors are relative to the strain's energy norm √(ε C ε), and the stress is measured in √(σ C⁻¹ σ). Measured: 5e-15.
ROUND_OFF = 10 * 10 * EPS


@ti.kernel
def _respond(
    out: ti.types.ndarray(),
    strain: ti.types.ndarray(),
    records: ti.template(),
    law: ti.template(),
    orthotropic: ti.template(),
):
    for i in range(strain.shape[0]):
        given = ti.Vector([strain[i, 0], strain[i, 1], strain[i, 2]])
        stress, energy, state = fabric.response(given, records[i], law, orthotropic)
        folds = fabric.fold_strain(given, stress, records[i])
        out[i, 0] = energy
        out[i, 1] = state
        for c in ti.static(range(3)):
            out[i, 2 + c] = stress[c]
            out[i, 5 + c] = folds[c]


@cache
def _records() -> Any:
    """Fabrics of all probes, one probe's at a time: a field of its own for each would compile everything anew."""
    return fabric.fabric_record(ti.f64).field(shape=4096)


@ti.kernel
def _take(records: ti.template(), constants: ti.types.ndarray()):
    for k in range(constants.shape[0]):
        for number in ti.static(range(len(fabric.CONSTANTS))):
            records.get_member_field(fabric.CONSTANTS[number])[k] = constants[k, number]


@ti.kernel
def _root(out: ti.types.ndarray(), given: ti.types.ndarray()):
    for i in range(given.shape[0]):
        out[i] = fabric.wrinkle_direction_root(given[i, 0], given[i, 1], given[i, 2], given[i, 3])


class Probe:
    """The engine's law on arrays of strains, one fabric each."""

    def __init__(self, moduli: Floats, law: str = "tension_field", *, orthotropic: bool = True) -> None:
        self.law, self.orthotropic = law, orthotropic
        fabrics = tuple(
            FabricConstants(e_warp=a, e_weft=b, poisson=nu, shear=g, thickness=1.0) for a, b, nu, g in moduli.tolist()
        )
        self.constants = np.array([[one.record()[name] for name in fabric.CONSTANTS] for one in fabrics])

    def __call__(self, strain: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Stress, energy density, state and fold strain."""
        out = np.zeros((len(strain), 8))
        assert len(strain) <= len(self.constants) <= _records().shape[0]
        _take(_records(), self.constants)
        _respond(out, np.ascontiguousarray(strain), _records(), self.law, self.orthotropic)
        return out[:, 2:5], out[:, 0], out[:, 1].astype(np.int32), out[:, 5:]


def energy_norm(strain: Floats, moduli: Floats) -> Floats:
    """√(ε C ε)."""
    return np.sqrt(np.einsum("ni,nij,nj->n", strain, oracle.stiffness(moduli), strain)).astype(np.float64)


def mixed_states(rng: np.random.Generator, moduli: Floats) -> Floats:
    """Random strains, about a third in each state."""
    parts = [oracle.manufactured(rng, moduli, state)[0] for state in STATES]
    return np.choose(rng.integers(3, size=(len(moduli), 1)), parts)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("state", STATES)
def test_tension_field_is_the_brute_force_maximum(seed: int, state: int) -> None:
    """Stress, energy and state equal the oracle's search over directions and the stress the strain was made from."""
    rng = np.random.default_rng(seed)
    moduli = oracle.random_moduli(rng, COUNT)
    strain, made_from = oracle.manufactured(rng, moduli, state)
    stress, energy, found, _ = Probe(moduli)(strain)
    searched, searched_energy, searched_state = oracle.tension_field(strain, moduli)
    size = energy_norm(strain, moduli)
    assert np.array_equal(found, np.full(COUNT, state))
    assert np.array_equal(found, searched_state)
    assert np.max(oracle.compliance_norm(stress - searched, moduli) / size) < ROUND_OFF
    assert np.max(oracle.compliance_norm(stress - made_from, moduli) / size) < ROUND_OFF
    assert np.max(np.abs(energy - searched_energy) / size**2) < ROUND_OFF


@pytest.mark.parametrize("seed", SEEDS)
def test_tension_field_meets_the_optimality_conditions(seed: int) -> None:
    """σ ≥ 0, fold strain ≥ 0, and no work of one on the other: together these define the projection."""
    rng = np.random.default_rng(seed)
    moduli = oracle.random_moduli(rng, COUNT)
    strain = mixed_states(rng, moduli)
    stress, _, state, folds = Probe(moduli)(strain)
    root = np.sqrt(moduli[:, :2])
    scaling = np.stack([root[:, 0], root[:, 1], np.sqrt(root[:, 0] * root[:, 1])], axis=1)
    size = energy_norm(strain, moduli)[:, None]
    # Scaled by √E both tensors are comparable with the energy norm; definiteness does not depend on the scaling.
    scaled_stress, scaled_folds = stress / scaling / size, folds * scaling / size
    # The shear compliance may exceed the others by 1e6 and multiplies the round-off of its stress.
    softest = np.sqrt(np.maximum(1.0, root[:, 0] * root[:, 1] / moduli[:, 3]))
    assert oracle.principal(scaled_stress, strain=False)[1].min() > -4 * EPS
    assert (oracle.principal(scaled_folds, strain=True)[1] / softest).min() > -ROUND_OFF
    assert np.max(np.abs(np.sum(scaled_stress * scaled_folds, axis=1))) < ROUND_OFF
    assert np.max(np.abs(scaled_folds[state == TAUT] / softest[state == TAUT, None])) < ROUND_OFF


@pytest.mark.parametrize("seed", SEEDS)
def test_stress_is_continuous_across_the_borders_of_the_states(seed: int) -> None:
    """A step δ across a border changes the stress by no more than δ: the projection is non-expansive in the energy norm."""
    rng = np.random.default_rng(seed)
    moduli = oracle.random_moduli(rng, COUNT)
    probe = Probe(moduli)
    tension, _ = oracle.manufactured(rng, moduli, WRINKLED)
    angle, _ = oracle.best_direction(tension, moduli)
    along, across = oracle.uniaxial(angle), oracle.uniaxial(angle + np.pi / 2)
    pulled = oracle.apply(oracle.compliance(moduli), along)
    spread = oracle.apply(oracle.compliance(moduli), across)
    folded, shrunk = -across * [1, 1, 2], -along * [1, 1, 2]
    for states, border, inward, outward in (
        ((TAUT, WRINKLED), pulled, spread, folded),
        ((WRINKLED, SLACK), folded, pulled, shrunk),
    ):
        border, inward, outward = (
            (one / energy_norm(one, moduli)[:, None]).astype(np.float64) for one in (border, inward, outward)
        )
        for delta in (1e-2, 1e-5, 1e-8, 1e-11):
            inside, outside = probe(border + delta * inward), probe(border + delta * outward)
            jump = oracle.compliance_norm(outside[0] - inside[0], moduli)
            assert np.max(jump) < 2 * delta + ROUND_OFF
            if delta >= 1e-8:  # below, round-off in the strain itself may put a case on either side
                assert np.all(inside[2] == states[0]), (seed, delta)
                assert np.all(outside[2] == states[1]), (seed, delta)


@pytest.mark.parametrize("seed", SEEDS)
def test_response_is_non_expansive_and_its_energy_convex(seed: int) -> None:
    """Between any two strains |Δσ| ≤ |Δε| in the energy norm, and W(middle) ≤ the mean of W at the ends."""
    rng = np.random.default_rng(seed)
    moduli = oracle.random_moduli(rng, 2000)
    first, second = mixed_states(rng, moduli), mixed_states(rng, moduli)
    probe = Probe(moduli)
    (s1, w1, k1, _), (s2, w2, k2, _), (_, w, _, _) = probe(first), probe(second), probe(0.5 * (first + second))
    assert len(set(zip(k1.tolist(), k2.tolist(), strict=True))) == 9
    size = energy_norm(first, moduli) + energy_norm(second, moduli)
    excess = oracle.compliance_norm(s1 - s2, moduli) - energy_norm(first - second, moduli)
    assert np.max(excess / size) < ROUND_OFF
    assert np.max((w - 0.5 * (w1 + w2)) / size**2) < ROUND_OFF


@pytest.mark.parametrize("law", ["none", "tension_field"])
@pytest.mark.parametrize("state", STATES)
def test_stress_is_the_derivative_of_the_energy(law: str, state: int) -> None:
    """Fourth-order central differences in the energy norm's own directions agree to 1e-7 of the strain's norm."""
    rng = np.random.default_rng(10 + state)
    moduli = oracle.random_moduli(rng, COUNT)
    strain, _ = oracle.manufactured(rng, moduli, state)
    probe = Probe(moduli, law)
    stress = probe(strain)[0]
    size = energy_norm(strain, moduli)
    for direction in np.eye(3):
        unit = direction / energy_norm(np.tile(direction, (COUNT, 1)), moduli)[:, None]
        # Round-off gives eps/1e-6 = 2e-10, truncation less; but for the few strains within 2e-6 of a border, where the
        # second derivative jumps by at most 1, the step stays within one state.
        step = 1e-6 * size[:, None] * unit
        w = [probe(strain + k * step)[1] for k in (-2, -1, 1, 2)]
        slope = (w[0] - 8 * w[1] + 8 * w[2] - w[3]) / (12 * 1e-6 * size)
        same = np.all([probe(strain + k * step)[2] == state for k in (-2, 2)], axis=0) | (law == "none")
        assert same.mean() > 0.9
        error = np.abs(slope - np.sum(stress * unit, axis=1)) / size
        assert np.max(error[same]) < 1e-7
        assert np.max(error) < 2e-6


def test_isotropic_limit_is_the_closed_form() -> None:
    """ε₂ < -ν ε₁ is wrinkled with E ε₁ along the major strain, ε₁ ≤ 0 is slack; with and without the direction search."""
    rng = np.random.default_rng(4)
    e, nu = 10 ** rng.uniform(-3, 3, COUNT), rng.uniform(-0.9, 0.9, COUNT)
    moduli = np.stack([e, e, nu, e / (2 * (1 + nu))], axis=1)
    major, angle = rng.uniform(-0.3, 1, COUNT), rng.uniform(0, np.pi, COUNT)
    minor = major - rng.uniform(0, 2, COUNT)
    along, across = oracle.uniaxial(angle), oracle.uniaxial(angle + np.pi / 2)
    strain = (major[:, None] * along + minor[:, None] * across) * [1, 1, 2]
    plane = e / (1 - nu**2)
    taut = (plane * (major + nu * minor))[:, None] * along + (plane * (minor + nu * major))[:, None] * across
    uniaxial = (e * major)[:, None] * along
    state = np.where(minor >= -nu * major, TAUT, np.where(major > 0, WRINKLED, SLACK))
    state = np.where((major <= 0) & (minor < -nu * major), SLACK, state)
    expected = np.choose(state[:, None], [taut, uniaxial, 0 * taut])
    assert set(state) == set(STATES)
    for orthotropic in (False, True):
        stress, _, found, _ = Probe(moduli, orthotropic=orthotropic)(strain)
        assert np.array_equal(found, state)
        assert np.max(np.abs(stress - expected) / (plane * 3)[:, None]) < 20 * EPS  # |ε₁| + |ε₂| < 4


def test_published_points() -> None:
    """Uniaxial stretch with excess contraction carries E ε; a wrinkled sheet in pure shear γ carries E γ/4 (Wagner)."""
    stress, _, state, _ = Probe(np.array([[2.0, 2.0, 0.3, 2 / 2.6]] * 2), orthotropic=False)(
        np.array([[0.01, -0.05, 0.0], [-0.01, -0.01, 0.1]])
    )
    assert state.tolist() == [WRINKLED, WRINKLED]
    assert stress[0] == pytest.approx([0.02, 0.0, 0.0], abs=1e-16)  # one rounding of 0.02
    # E₁ = γ/2 - 0.01 along 45°: half of E E₁ in each component.
    assert stress[1] == pytest.approx([0.04, 0.04, 0.04], rel=1e-14)


@pytest.mark.parametrize("seed", SEEDS)
def test_clip_removes_negative_principal_stress_and_keeps_the_direction(seed: int) -> None:
    """The engine's closed form equals the eigenvalue decomposition of C ε with its negative values dropped."""
    rng = np.random.default_rng(seed)
    moduli = oracle.random_moduli(rng, COUNT)
    root = np.sqrt(moduli[:, :2])
    strain = rng.normal(size=(COUNT, 3)) / np.stack([root[:, 0], root[:, 1], np.sqrt(moduli[:, 3])], axis=1)
    stress, _, state, _ = Probe(moduli, "clip")(strain)
    expected, expected_state = oracle.clipped(strain, moduli)
    trial = oracle.apply(oracle.stiffness(moduli), strain).astype(np.float64)
    size = np.linalg.norm(trial, axis=1)
    assert set(expected_state) == set(STATES)
    assert np.array_equal(state, expected_state)
    # Components of one stress differ by up to the ratio of the moduli: errors are relative to its norm.
    assert np.max(np.linalg.norm(stress - expected, axis=1) / size) < ROUND_OFF
    assert np.min(oracle.principal(stress, strain=False)[1] / size) > -4 * EPS
    wrinkled = state == WRINKLED
    # Same principal axes: the stress commutes with the trial stress.
    twist = (stress[:, 0] - stress[:, 1]) * trial[:, 2] - (trial[:, 0] - trial[:, 1]) * stress[:, 2]
    assert np.max(np.abs(twist / size**2)[wrinkled]) < ROUND_OFF


def test_no_law_is_linear() -> None:
    """σ = C ε, always called taut."""
    rng = np.random.default_rng(5)
    moduli = oracle.random_moduli(rng, COUNT)
    strain = mixed_states(rng, moduli)
    stress, energy, state, folds = Probe(moduli, "none")(strain)
    expected = oracle.apply(oracle.stiffness(moduli), strain)
    size = energy_norm(strain, moduli)
    assert not state.any()
    assert np.max(oracle.compliance_norm(stress - expected, moduli) / size) < ROUND_OFF
    assert np.max(np.abs(energy / (0.5 * size**2) - 1)) < ROUND_OFF
    assert np.max(oracle.compliance_norm(oracle.apply(oracle.stiffness(moduli), folds), moduli) / size) < ROUND_OFF


@pytest.mark.parametrize("seed", SEEDS)
def test_direction_root_solves_its_equation(seed: int) -> None:
    """h cos φ - d(1+η) sin φ - m η sin φ cos φ vanishes to round-off, over 24 decades of its coefficients."""
    rng = np.random.default_rng(seed)
    d, h = 10 ** rng.uniform(-12, 12, (2, 20000))
    m = rng.choice([-1, 1], 20000) * 10 ** rng.uniform(-12, 12, 20000)
    eta = np.where(rng.random(20000) < 0.3, -rng.random(20000), 10 ** rng.uniform(-6, 8, 20000))
    d[:2000], h[2000:4000] = 0.0, 0.0
    given = np.stack([m, d, h, eta], axis=1)
    t = np.zeros(len(given))
    _root(t, given)
    cosine, sine = (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)
    terms = np.stack([h * cosine, -d * (1 + eta) * sine, -m * eta * sine * cosine])
    assert np.all((t >= 0) & (t <= 1))
    # Where t is near 1, cos φ is the small difference 1 - t² and carries the rounding of t: so does h cos φ.
    size = (
        np.abs(terms).sum(axis=0) + h + np.abs(m * eta) * sine + np.finfo(float).tiny
    )  # all terms vanish for h = 0, φ = 0
    assert np.max(np.abs(terms.sum(axis=0)) / size) < 8 * EPS
