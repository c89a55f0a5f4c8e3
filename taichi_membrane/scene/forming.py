"""What a scene that begins with form finding needs, and what is not implemented with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taichi_membrane.scene.element_field import ElementField

if TYPE_CHECKING:
    from taichi_membrane.scene.models import Scene


def check(scene: Scene) -> None:
    """Refuse form finding that is not the first stage, fabrics without a tension to give it, and cables whose force nothing finds.

    :raises ValueError: with the key and what is needed.
    """
    for number, stage in enumerate(scene.stages, 1):
        if number > 1 and stage.kind == "form_find":
            raise ValueError(
                f"stages.{stage.name}.kind = 'form_find': it is stage {number}; the rest shape is found before all else, by the "
                "first one"
            )
    if not scene.forms:
        for name, cable in scene.cables.items():
            key = "force" if cable.force is not None else "force_density" if cable.force_density is not None else None
            if key is not None:
                raise ValueError(
                    f"cables.{name}.{key} is for a scene whose first stage is of kind 'form_find'; "
                    "give prestress, unstressed or length"
                )
        return
    if scene.touchable:
        raise ValueError(
            f"stages.{scene.stages[0].name}.kind = 'form_find' is not implemented for a scene with planes, obstacles or contact"
        )
    fabrics = {"fabric": scene.fabric, **{f"fabrics.{name}": one for name, one in scene.fabrics.items()}}
    where = f"stages.{scene.stages[0].name}"
    for name, fabric in fabrics.items():
        if fabric is None:
            continue
        key = f"{name}.{fabric.prestress_key}"
        if isinstance(fabric.given_prestress, ElementField):
            raise ValueError(f"{key}: {where} finds the shape of one stress of each fabric, not of element data")
        warp, weft, shear = fabric.given_prestress
        if warp <= 0 or weft <= 0 or warp * weft <= shear**2:
            raise ValueError(
                f"{key} = {list(fabric.given_prestress)}: {where} finds the shape of this stress, which "
                "has to be a tension in all directions: warp and weft above 0, and warp · weft above shear²"
            )
