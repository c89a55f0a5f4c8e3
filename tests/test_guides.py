"""The guides, carried out block by block: they end as they say, and print what they show."""

from __future__ import annotations

from pathlib import Path

import pytest
from guide_text import Block, Reader, blocks, first_missing

from taichi_membrane.device.runtime import Runtime

GUIDES = Path(__file__).resolve().parent.parent / "docs/guides"
NAMES = sorted(path.stem for path in GUIDES.glob("*.md") if path.name != "README.md")


@pytest.mark.parametrize("name", NAMES)
def test_a_guide_does_what_it_says(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, runtime_cpu: Runtime
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    found = blocks((GUIDES / f"{name}.md").read_text(encoding="utf-8"))
    assert {"sh", "text"} <= {block.kind for block in found}
    reader = Reader()
    for block in found:
        reader.carry_out(block)


def test_the_index_names_every_guide_once() -> None:
    index = (GUIDES / "README.md").read_text(encoding="utf-8")
    assert [index.count(f"]({name}.md)") for name in NAMES] == [1] * len(NAMES)


@pytest.mark.parametrize(
    ("shown", "missing"),
    [
        ("tip 1.25 mm", None),
        ("tip 1.24 mm\nload … steps", None),  # one unit in the last digit shown
        ("tip 1.2 … 3", None),
        ("tip 1.23 mm", "tip 1.23 mm"),
        ("3 steps\ntip 1.25", "tip 1.25"),  # not in this order
        ("load 2 steps", "load 2 steps"),  # counts are exact
        ("tip 1.25 m", "tip 1.25 m"),
    ],
)
def test_what_is_shown_is_compared_to_its_digits(shown: str, missing: str | None) -> None:
    assert first_missing(shown, "tip 1.25 mm\n  load\n3 steps") == missing


def test_a_guide_that_is_wrong_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    reader = Reader()
    reader.carry_out(Block("toml", "# own.toml\nname = 'own'\n", 1))
    reader.carry_out(Block("toml", "# at the end of own.toml\ntitle = 'x'\n", 4))
    assert (tmp_path / "own.toml").read_text().count("\n") == 5
    reader.carry_out(Block("sh", "taichi-membrane check own.toml  # exit code 2\n", 8))
    reader.carry_out(Block("text", "own.toml: …\n", 11))
    for wrong in (
        Block("sh", "taichi-membrane check own.toml\n", 1),
        Block("sh", "rm own.toml\n", 1),
        Block("text", "converged\n", 1),
        Block("toml", "# own.toml\n", 1),
    ):
        with pytest.raises(AssertionError, match="line 1"):
            reader.carry_out(wrong)
