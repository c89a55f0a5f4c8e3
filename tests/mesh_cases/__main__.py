"""Writes docs/meshes.md from the table: ``PYTHONPATH=tests python -m mesh_cases``."""

from __future__ import annotations

from mesh_cases.page import PAGE, page

PAGE.write_text(page(), encoding="utf-8")
