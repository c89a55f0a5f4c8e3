"""Inflated bodies: sphere, cylinder, Hencky's disc, Mylar balloon, square airbag."""

from __future__ import annotations

import numpy as np

from taichi_membrane.verification import closed_forms
from taichi_membrane.verification.case import Case, Curve, Outcome, Quantity, solve
from taichi_membrane.verification.shooting import inflated_disc

SHOOTING = "axisymmetric St Venant-Kirchhoff membrane, solved by shooting"


def sphere() -> Case:
    """A sphere blown up a little and to one and a half times its size."""
    small, large, nu = 0.0284300, 1.1904762, 0.3
    source = "p R = E t (λ - 1/λ)/(1 - ν), S = p r/2"

    def run(size: int) -> Outcome:
        held = {f"{axis}_zero": f"{axis} = 0 within 1e-9" for axis in "xyz"}
        result = solve(
            {
                "mesh": {"shape": "sphere", "radius": 1.0, "divisions": size},
                "fabric": {"E": 1.0, "nu": nu, "thickness": 1.0},
                "groups": {name: {"where": where} for name, where in held.items()},
                "supports": [{"group": name, "hold": name[0]} for name in held],
                "stages": [{"name": "small", "pressure": small}, {"name": "large", "pressure": large, "steps": 2}],
                "probes": {
                    "radius": {"kind": "radius", "group": "all", "axis": "centre"},
                    "stress": {"kind": "stress", "reduce": "mean"},
                },
            }
        )
        radius, stress = result.probe("radius"), result.probe("stress")
        return Outcome(
            values={
                "extension, small": radius[0] - 1.0,
                "extension, large": radius[-1] - 1.0,
                "stress, large": stress[-1],
            }
        )

    stretches = [closed_forms.sphere_stretch(p, 1.0, 1.0, nu) for p in (small, large)]
    return Case(
        name="sphere",
        title="Inflated sphere",
        setting="St Venant-Kirchhoff sphere, ν = 0.3, p R/(E t) = 0.0284 (stretch 1.01) and 1.1905 (stretch 1.5).",
        size_label="elements along a quarter of a great circle",
        sizes=(6, 12, 24),
        more_sizes=(48, 96),
        quantities=(
            Quantity(name="extension, small", reference=stretches[0] - 1.0, source=source, bound=0.005),
            Quantity(name="extension, large", reference=stretches[1] - 1.0, source=source, bound=0.005),
            Quantity(
                name="stress, large", reference=(stretches[1] ** 2 - 1.0) / (2.0 * (1.0 - nu)), source=source, bound=0.005
            ),
        ),
        run=run,
    )


def cylinder() -> Case:
    """A tube with hemispherical ends, away from them."""
    radius, length, stiffness, nu = 1.0, 5.0, 1.0, 0.3
    small, large = 0.0021875, 0.21875
    source = "S_t = p R λ_x, λ_x S_x = p R λ_t²/2 (closed ends)"

    def run(size: int) -> Outcome:
        result = solve(
            {
                "mesh": {"shape": "tube", "radius": radius, "length": length, "around": 4 * size, "along": 4 * size},
                "fabric": {"E": stiffness, "nu": nu, "thickness": 1.0},
                "groups": {
                    "y_zero": {"where": "y = 0 within 1e-9"},
                    "z_zero": {"where": "z = 0 within 1e-9 and x < 1e-9"},
                    "quarter": {"where": f"x = {length / 4} within 1e-9"},
                    "middle_wall": {"where": f"x < {length / 4}", "kind": "elements"},
                },
                "supports": [
                    {"group": "start", "hold": "x"},
                    {"group": "y_zero", "hold": "y"},
                    {"group": "z_zero", "hold": "z"},
                ],
                "stages": [{"name": "small", "pressure": small}, {"name": "large", "pressure": large, "steps": 2}],
                "probes": {
                    "radius": {"kind": "radius", "group": "start", "axis": "x"},
                    "advance": {"kind": "displacement", "group": "quarter", "component": "x"},
                    "stress": {"kind": "stress", "group": "middle_wall", "reduce": "mean"},
                },
            }
        )
        hoop, axial, stress = result.probe("radius"), 4.0 * result.probe("advance") / length, result.probe("stress")
        return Outcome(
            values={
                "hoop extension, small": hoop[0] - 1.0,
                "axial extension, small": axial[0],
                "hoop extension, large": hoop[-1] - 1.0,
                "axial extension, large": axial[-1],
                "hoop stress, large": stress[-1],
            }
        )

    quantities = []
    for word, pressure in (("small", small), ("large", large)):
        hoop, axial = closed_forms.cylinder_stretches(pressure, radius, stiffness, nu)
        for name, value in (("hoop", hoop - 1.0), ("axial", axial - 1.0)):
            quantities.append(Quantity(name=f"{name} extension, {word}", reference=value, source=source, bound=0.005))
    quantities.append(
        Quantity(name="hoop stress, large", reference=large * radius * axial, source=source, bound=0.005)
    )
    return Case(
        name="cylinder",
        title="Inflated tube with closed ends",
        setting="St Venant-Kirchhoff tube with hemispherical caps, half length 5 R, ν = 0.3, p R/(E t) = 0.0021875 and 0.21875; "
        "measured in its middle.",
        size_label="elements round a quarter",
        sizes=(4, 8, 16),
        more_sizes=(32, 64),
        quantities=tuple(quantities),
        run=run,
    )


def hencky() -> Case:
    """A flat disc with its rim held under a dead lateral load, at a load where Hencky's theory is exact."""
    load, nu = 1e-6, 0.3
    source = "Hencky's series (1915)"

    def run(size: int) -> Outcome:
        result = solve(
            {
                "mesh": {"shape": "disc", "radius": 1.0, "rings": size},
                "fabric": {"E": 1.0, "nu": nu, "thickness": 1.0},
                "groups": {"middle": {"where": f"r < {1.0 / size}", "kind": "elements"}},
                "supports": [{"group": "rim", "hold": "xyz"}],
                "pressures": {"load": {"kind": "fixed"}},
                "stages": [{"name": "load", "pressure": load}],
                "probes": {
                    "rise": {"kind": "displacement", "group": "centre", "component": "z"},
                    "stress": {"kind": "stress", "group": "middle", "reduce": "mean"},
                },
            }
        )
        return Outcome(values={"rise": result.probe("rise")[-1], "stress in the middle": result.probe("stress")[-1]})

    rise, stress = closed_forms.hencky_disc(load, nu)
    theory = 4e-5  # the terms that Hencky's kinematics leaves out, at this load
    return Case(
        name="hencky",
        title="Hencky's disc",
        setting="Flat disc, rim held, dead lateral load Q = q a/(E t) = 1e-6, ν = 0.3.",
        size_label="rings",
        sizes=(8, 16, 32),
        more_sizes=(64, 128),
        quantities=(
            Quantity(name="rise", reference=rise, source=source, bound=0.005, resolution=theory),
            Quantity(
                name="stress in the middle", reference=stress, source=source, bound=0.005, order=1.0, resolution=theory
            ),
        ),
        run=run,
    )


def disc() -> Case:
    """The same disc under pressure that follows it, at loads where Hencky's theory ends."""
    small, large, nu = 1e-2, 1e-1, 0.3

    def run(size: int) -> Outcome:
        result = solve(
            {
                "mesh": {"shape": "disc", "radius": 1.0, "rings": size},
                "fabric": {"E": 1.0, "nu": nu, "thickness": 1.0},
                "groups": {
                    "middle": {"where": f"r < {1.0 / size}", "kind": "elements"},
                    "ray": {"where": "y = 0 within 1e-9 and x > -1e-9"},
                },
                "supports": [{"group": "rim", "hold": "xyz"}],
                "stages": [{"name": "small", "pressure": small}, {"name": "large", "pressure": large, "steps": 2}],
                "probes": {
                    "rise": {"kind": "displacement", "group": "centre", "component": "z"},
                    "volume": {"kind": "volume"},
                    "stress": {"kind": "stress", "group": "middle", "reduce": "mean"},
                },
            }
        )
        ray = result.mesh.node_groups["ray"]
        place = result.mesh.points[ray] + result.steps[-1].displacement[ray]
        order = np.argsort(place[:, 0])
        return Outcome(
            values={
                "rise, Q = 0.01": result.probe("rise")[0],
                "rise, Q = 0.1": result.probe("rise")[-1],
                "volume, Q = 0.1": result.probe("volume")[-1],
                "stress in the middle, Q = 0.1": result.probe("stress")[-1],
            },
            points=(place[order, 0], place[order, 2]),
        )

    first, last = (inflated_disc(load, nu, rim="held") for load in (small, large))
    return Case(
        name="disc",
        title="Flat disc under follower pressure",
        setting="Flat disc, rim held, pressure Q = p a/(E t) = 0.01 and 0.1, ν = 0.3.",
        size_label="rings",
        sizes=(8, 16, 32),
        more_sizes=(64, 128),
        quantities=(
            Quantity(name="rise, Q = 0.01", reference=first.rise, source=SHOOTING, bound=0.005),
            Quantity(name="rise, Q = 0.1", reference=last.rise, source=SHOOTING, bound=0.005),
            Quantity(name="volume, Q = 0.1", reference=last.volume, source=SHOOTING, bound=0.005),
            Quantity(
                name="stress in the middle, Q = 0.1",
                reference=last.pole_resultant,
                source=SHOOTING,
                bound=0.005,
                order=1.0,
            ),
        ),
        run=run,
        curve=Curve(x_label="radius / a", y_label="height / a", x=last.radius, y=last.height),
    )
