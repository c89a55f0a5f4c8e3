"""A case of the table of mesh formats, and the sheet that most files hold: nine nodes at whole x and y, eight triangles, area 4."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

NODES = [(x, y, 0) for y in range(3) for x in range(3)]
TRIANGLES = [(1, 2, 5), (1, 5, 4), (2, 3, 6), (2, 6, 5), (4, 5, 8), (4, 8, 7), (5, 6, 9), (5, 9, 8)]
QUADS = [(1, 2, 5, 4), (2, 3, 6, 5), (4, 5, 8, 7), (5, 6, 9, 8)]


@dataclass(frozen=True)
class Read:
    """A mesh that must come out: counts, area, sizes of groups, components of element data, words of its notes."""

    triangles: int = 8
    area: float = 4.0
    nodes: int = 9
    tri_groups: dict[str, int] = field(default_factory=dict)
    node_groups: dict[str, int] = field(default_factory=dict)
    line_groups: dict[str, int] = field(default_factory=dict)
    loose_groups: dict[str, int] = field(default_factory=dict)
    lines: int = 0
    tri_fields: dict[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Case:
    """A file and its verdict: what is read, or the words of the refusal. ``others`` are files beside it."""

    format: str
    feature: str
    name: str
    content: str | bytes
    verdict: Read | str
    others: dict[str, str] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """Write the file and those beside it; return its path."""
        for name, content in {**self.others, self.name: self.content}.items():
            path = folder / name
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return folder / self.name


def rows(items: list[tuple[int, ...]], first: int = 1, separator: str = ", ") -> str:
    """Numbered lines."""
    return "".join(separator.join(map(str, (n, *item))) + "\n" for n, item in enumerate(items, first))
