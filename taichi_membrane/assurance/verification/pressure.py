"""Inflated bodies: sphere, cylinder, Hencky's disc, Mylar balloon, square airbag."""

from __future__ import annotations

import numpy as np

from taichi_membrane import shapes
from taichi_membrane.assurance.verification import closed_forms
from taichi_membrane.assurance.verification.benchmark import Benchmark, Curve, Quantity, Solution, solve
from taichi_membrane.assurance.verification.shooting import inflated_disc
from taichi_membrane.mesh import Mesh

SHOOTING = "axisymmetric St Venant-Kirchhoff membrane, solved by shooting"


def sphere(order: int = 1) -> Benchmark:
    """A sphere blown up a little and to one and a half times its size."""
    small, large, nu = 0.0284300, 1.1904762, 0.3
    source = "p R = E t (λ - 1/λ)/(1 - ν), S = p r/2"

    def run(size: int) -> Solution:
        held = {f"{axis}_zero": f"{axis} = 0 within 1e-9" for axis in "xyz"}
        result = solve(
            {
                "mesh": {"shape": "sphere", "radius": 1.0, "divisions": size, "order": order},
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
        return Solution(
            values={
                "extension, small": radius[0] - 1.0,
                "extension, large": radius[-1] - 1.0,
                "stress, large": stress[-1],
            }
        )

    stretches = [closed_forms.sphere_stretch(p, 1.0, 1.0, nu) for p in (small, large)]
    return Benchmark(
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
                name="stress, large",
                reference=(stretches[1] ** 2 - 1.0) / (2.0 * (1.0 - nu)),
                source=source,
                bound=0.005,
            ),
        ),
        run=run,
    )


def cylinder(order: int = 1) -> Benchmark:
    """A tube with hemispherical ends, away from them."""
    radius, length, stiffness, nu = 1.0, 5.0, 1.0, 0.3
    small, large = 0.0021875, 0.21875
    source = "S_t = p R λ_x, λ_x S_x = p R λ_t²/2 (closed ends)"

    def run(size: int) -> Solution:
        result = solve(
            {
                "mesh": {
                    "shape": "tube", "radius": radius, "length": length, "around": 4 * size, "along": 4 * size, "order": order,
                },
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
        )  # fmt: skip
        hoop, axial, stress = result.probe("radius"), 4.0 * result.probe("advance") / length, result.probe("stress")
        return Solution(
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
    quantities.append(Quantity(name="hoop stress, large", reference=large * radius * axial, source=source, bound=0.005))
    return Benchmark(
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


def hencky() -> Benchmark:
    """A flat disc with its rim held under a dead lateral load, at a load where Hencky's theory is exact."""
    load, nu = 1e-6, 0.3
    source = "Hencky's series (1915)"

    def run(size: int) -> Solution:
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
        return Solution(values={"rise": result.probe("rise")[-1], "stress in the middle": result.probe("stress")[-1]})

    rise, stress = closed_forms.hencky_disc(load, nu)
    theory = 4e-5  # the terms that Hencky's kinematics leaves out, at this load
    return Benchmark(
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


def disc(order: int = 1) -> Benchmark:
    """The same disc under pressure that follows it, at loads where Hencky's theory ends."""
    small, large, nu = 1e-2, 1e-1, 0.3

    def run(size: int) -> Solution:
        result = solve(
            {
                "mesh": {"shape": "disc", "radius": 1.0, "rings": size, "order": order},
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
        along = np.argsort(place[:, 0])
        return Solution(
            values={
                "rise, Q = 0.01": result.probe("rise")[0],
                "rise, Q = 0.1": result.probe("rise")[-1],
                "volume, Q = 0.1": result.probe("volume")[-1],
                "stress in the middle, Q = 0.1": result.probe("stress")[-1],
            },
            points=(place[along, 0], place[along, 2]),
        )

    first, last = (inflated_disc(load, nu, rim="held") for load in (small, large))
    return Benchmark(
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


def mylar() -> Benchmark:
    """Two flat discs seamed at their rims and inflated: one thin wedge of the upper one, symmetric about all its sides."""
    loads = {"0.01": 1e-2, "0.001": 1e-3, "1e-7": 1e-7}
    nu = 0.3

    def run(size: int) -> Solution:
        # The wedge narrows as the rings do, so that the error of the chord, which stands for the arc, falls with them.
        sectors = 8 * size
        angle = 360.0 / sectors
        end = np.deg2rad(angle)
        result = solve(
            {
                "mesh": {"shape": "given"},
                "fabric": {"E": 1.0, "nu": nu, "thickness": 1.0},
                "supports": [
                    {"group": "rim", "hold": "z"},
                    {"group": "centre", "hold": "xy"},
                    {"group": "side_start", "hold": "y"},
                    {"group": "side_end", "normal": [-np.sin(end), np.cos(end), 0.0]},
                ],
                "stages": [{"name": f"power{power}", "pressure": 10.0**-power} for power in range(2, 8)],
                "probes": {
                    "rim": {"kind": "displacement", "group": "corner", "component": "x"},
                    "rise": {"kind": "displacement", "group": "centre", "component": "z"},
                    "volume": {"kind": "volume"},
                },
            },
            _domed_wedge(angle, size),
        )
        values = {}
        for word, load in loads.items():
            step = next(one for one in result.steps if one.pressures["inside"] == load)
            values[f"equatorial radius, Q = {word}"] = 1.0 + step.probes["rim"]
            values[f"half thickness, Q = {word}"] = step.probes["rise"]
            values[f"volume, Q = {word}"] = 2.0 * sectors * step.probes["volume"]
        side = result.mesh.node_groups["side_start"]
        place = result.mesh.points[side] + result.steps[-1].displacement[side]
        return Solution(values=values, points=(place[:, 0], place[:, 2]))

    limit = inflated_disc(loads["1e-7"], nu, rim="seam")
    return Benchmark(
        name="mylar",
        title="Mylar balloon",
        setting="Two flat discs seamed at the rim, ν = 0.3; Q = p a/(E t) = 1e-7 stands for inextensible discs. A wedge of one "
        "disc between planes of symmetry, because a full disc scallops along its rim.",
        size_label="rings",
        sizes=(16, 32, 64),
        more_sizes=(128, 256),
        quantities=_mylar_quantities(loads, nu),
        run=run,
        curve=Curve(x_label="radius / a", y_label="height / a", x=limit.radius, y=limit.height, exact="exact"),
    )


def _mylar_quantities(loads: dict[str, float], nu: float) -> tuple[Quantity, ...]:
    """Rim, half thickness and volume at each load, against inextensible discs or shooting."""
    quantities = []
    for word, load in loads.items():
        if word == "1e-7":
            reference, source, theory = closed_forms.mylar_balloon(), "inextensible discs, exact", 3e-5
        else:
            found = inflated_disc(load, nu, rim="seam")
            reference, source, theory = (found.rim, found.rise, 2.0 * found.volume), SHOOTING, 1e-6
        for name, value in zip(("equatorial radius", "half thickness", "volume"), reference, strict=True):
            quantities.append(
                Quantity(name=f"{name}, Q = {word}", reference=value, source=source, bound=0.005, resolution=theory)
            )
    return tuple(quantities)


def _domed_wedge(angle: float, rings: int) -> Mesh:
    """A wedge raised by a millionth: flat, it could still turn about its straight rim, as far as first-order motions go."""
    flat = shapes.wedge(radius=1.0, angle=angle, rings=rings)
    points = flat.points.copy()
    points[:, 2] = 1e-6 * (1.0 - points[:, 0] ** 2 - points[:, 1] ** 2)
    groups = {name: flat.node_groups[name] for name in ("centre", "rim", "side_start", "side_end")}
    return Mesh.build(points, flat.triangles, groups | {"corner": groups["rim"][:1]})


def airbag() -> Benchmark:
    """The square airbag of the literature: a quarter of its upper sheet."""
    side = 1.2 / np.sqrt(2.0) / 2.0

    def run(size: int) -> Solution:
        result = solve(
            {
                "mesh": {
                    "shape": "panel",
                    "width": side,
                    "height": side,
                    "along_x": size,
                    "along_y": size,
                    "pattern": "alternating",
                },
                "fabric": {"E": 588e6, "nu": 0.4, "thickness": 0.6e-3},
                "groups": {"middle": {"where": f"x < {side / 8} and y < {side / 8}", "kind": "elements"}},
                "supports": [
                    {"group": "x_min", "hold": "x"},
                    {"group": "y_min", "hold": "y"},
                    {"group": "x_max", "hold": "z"},
                    {"group": "y_max", "hold": "z"},
                ],
                "stages": [{"name": "inflate", "pressure": 5000.0}],
                "probes": {
                    "rise": {"kind": "displacement", "group": "corner_00", "component": "z"},
                    "edge": {"kind": "displacement", "group": "corner_10", "component": "x"},
                    "stress": {"kind": "stress", "group": "middle", "reduce": "mean"},
                },
            }
        )
        last = result.steps[-1].probes
        return Solution(
            values={
                "rise of the middle": last["rise"],
                "draw of the edge": -last["edge"],
                "stress in the middle": last["stress"],
            }
        )

    published = "Jarasjarungkiat, Wüchner and Bletzinger 2009"
    folds = "published meshes spread as far; the folds of the edges, and with them the last digits, depend on the mesh."
    digits = "two digits are published, from meshes of 8 by 8 and 10 by 10."
    bounds = {"rise of the middle": (0.2167, 0.005, folds), "draw of the edge": (0.1227, 0.06, folds)}
    bounds["stress in the middle"] = (3.8e6, 0.05, digits)
    return Benchmark(
        name="airbag",
        title="Square airbag",
        setting="Diagonal 1.2 m, t = 0.6 mm, E = 588 MPa, ν = 0.4, p = 5 kPa, initially flat; a quarter of the upper sheet.",
        size_label="elements along half a side",
        sizes=(8, 16, 32),
        more_sizes=(64,),
        quantities=tuple(
            Quantity(name=name, reference=value, source=published, bound=bound, order=None, remark=remark)
            for name, (value, bound, remark) in bounds.items()
        ),
        run=run,
    )
