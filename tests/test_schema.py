"""The words of a scene's keys: none without a meaning, and the page and the schema say what the models are."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import BaseModel

import taichi_membrane as tm
from taichi_membrane.scene import schema

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("model", schema.models(), ids=lambda model: model.__name__)
def test_every_key_has_a_meaning(model: type[BaseModel]) -> None:
    assert set(schema.meanings(model)) == set(model.model_fields)
    for key, text in schema.meanings(model).items():
        assert len(text) > 8, key
        assert text.endswith("."), key
    assert model.__doc__ is not None
    assert model.__doc__ != BaseModel.__doc__


def test_the_schema_has_every_meaning_and_examples_that_hold() -> None:
    made = schema.schema()
    tables = [made, *(made["$defs"][model.__name__] for model in schema.models()[1:])]
    entries = [entry for table in tables for entry in table["properties"].values()]
    assert all(entry["description"] for entry in entries)
    assert made["properties"]["name"]["examples"] == [tm.load_scene("airbag").name]
    assert sum("examples" in entry for entry in entries) > 0.4 * len(entries)


def test_an_example_is_what_a_shipped_scene_says() -> None:
    found = schema.examples()
    scene = tm.load_scene("cantilever")
    assert found[type(scene.mesh), "radius"] in {
        tm.load_scene(name).mesh.radius for name in ("cantilever", "collapse", "tube")
    }  # type: ignore[union-attr]


def test_the_page_is_that_of_the_models() -> None:
    assert (ROOT / "docs/scene.md").read_text(encoding="utf-8") == schema.page()


def test_every_model_has_a_section_with_all_its_keys() -> None:
    sections = schema.page().split("\n## ")[1:]
    assert [section.split("\n")[0] for section in sections] == [model.__name__ for model in schema.models()]
    for model, section in zip(schema.models(), sections, strict=True):
        assert [line.split("`")[1] for line in section.split("\n") if line.startswith("| `")] == list(
            model.model_fields
        )


def test_a_shipped_scene_is_found_by_name_from_python() -> None:
    scene = tm.load_scene("cantilever", ["mesh.around=8", "mesh.along=10"])
    assert scene.name == "cantilever"
    with pytest.raises(tm.InputError, match="did you mean 'cantilever'"):
        tm.load_scene("cantilver")
    with pytest.raises(tm.InputError, match="did you mean 'cantilever'"):
        tm.run("cantilver")
    result = tm.run(Path(ROOT / "scenes/tube.toml"))
    assert result.scene == tm.load_scene("tube")
