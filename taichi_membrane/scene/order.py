"""What scenes with six-node triangles cannot have."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taichi_membrane.scene.loads import SnowLoad, WaterLoad

if TYPE_CHECKING:
    from taichi_membrane.scene.models import Scene


def check(scene: Scene) -> None:
    """Refuse what six-node triangles do not have.

    :raises ValueError: with the key.
    """
    if scene.order == 1:
        return
    told = "is not implemented for six-node triangles (mesh.order = 2); use mesh.order = 1"
    for name, load in scene.loads.items():
        if isinstance(load, SnowLoad | WaterLoad):
            raise ValueError(f"loads.{name}: kind = {load.kind!r} {told}")
    if scene.touchable:
        where = "planes" if scene.planes else "obstacles" if scene.obstacles else "contact"
        raise ValueError(f"{where}: contact {told}")
    if scene.forms:
        raise ValueError(f"stages.{scene.stages[0].name}: form finding {told}")
