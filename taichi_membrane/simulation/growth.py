"""A scene's shrinkages and temperatures on the elements of its mesh: their stress-free extension."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene, Shrinkage
from taichi_membrane.simulation.groups import fabric_list, group_triangles
from taichi_membrane.simulation.load_state import ramp_targets


@dataclass(frozen=True, eq=False)
class Growth:
    """What shrinkages and temperatures do to each element; those that no stage uses are left out.

    :param extension: by driver, such as ``temperature.sun``: (tri_count, 2) relative extension in warp and weft at value 1.
    """

    extension: Mapping[str, Floats]

    @property
    def drivers(self) -> tuple[str, ...]:
        """Names of the drivers, in the order that the structure has their values."""
        return tuple(self.extension)

    @property
    def array(self) -> Floats | None:
        """(tri_count, 2, n) extension of all."""
        return np.stack(list(self.extension.values()), axis=2) if self.extension else None


def growth_of(scene: Scene, mesh: Mesh, tri_fabric: Ints) -> Growth:
    """A scene's shrinkages and temperatures on its mesh.

    :raises InputError: unknown groups; a temperature of elements that have no expansion; a stage that leaves nothing of a length.
    """
    extension: dict[str, Floats] = {}
    expansion = np.array([fabric.expansion for _, fabric in fabric_list(scene)])[tri_fabric]
    for kind, table in (("shrinkage", scene.shrinkages), ("temperature", scene.temperatures)):
        for name, one in table.items():
            key, unit = f"{kind}s.{name}", np.zeros((mesh.tri_count, 2))
            for group in [one.group] if isinstance(one.group, str) else one.group:
                members = group_triangles(mesh, group, f"{key}.group")
                unit[members] = [-one.warp, -one.weft] if isinstance(one, Shrinkage) else expansion[members]
            if not unit.any():
                raise InputError(f"{key}.group: no fabric of these elements has an expansion")
            if any(getattr(stage, f"{kind}s").get(name) for stage in scene.ramps):
                extension[f"{kind}.{name}"] = unit
    _check_lengths(scene, extension)
    return Growth(extension)


def _check_lengths(scene: Scene, extension: Mapping[str, Floats]) -> None:
    """Refuse a stage at whose end an element has lost its whole length."""
    for stage, target in ramp_targets(scene):
        total = sum((target.values[driver] * unit for driver, unit in extension.items()), start=np.zeros((1, 2)))
        if total.min() <= -1.0:
            element, side = np.unravel_index(total.argmin(), total.shape)
            raise InputError(
                f"{stage.key}: element {element} loses {-100.0 * total.min():.4g} % of its length along the "
                f"{('warp', 'weft')[side]}; nothing would be left"
            )
