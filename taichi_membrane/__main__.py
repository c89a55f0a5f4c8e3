"""``python -m taichi_membrane`` is the command ``taichi-membrane``."""

from __future__ import annotations

from taichi_membrane.commands.cli import main

if __name__ == "__main__":
    main()
