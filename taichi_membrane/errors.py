"""The one exception a user's mistake raises, and what a user's path leads to."""

from __future__ import annotations

import re
import stat
from pathlib import Path
from typing import Literal

_HEAD, _TAIL = 1500, 700  # characters of an overlong message that are kept; names and texts from files have any length


class InputError(ValueError):
    """Bad input, told in one message: what is wrong, where (file, key, element number), and the values or names allowed.

    The message is made one line of bounded length, with control characters (names in files may hold them) written out. The
    command line prints it without a traceback and ends with exit code 2.
    """

    def __init__(self, message: str) -> None:
        line = re.sub(r"\s*[\r\n]+\s*", " ", message)
        line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
        if len(line) > _HEAD + _TAIL:
            line = f"{line[:_HEAD]} … ({len(line) - _HEAD - _TAIL} characters left out) … {line[-_TAIL:]}"
        super().__init__(line)


def kind_of_path(path: Path) -> Literal["file", "folder", "device", "missing"]:
    """What a path given by a user leads to. A device, such as a pipe, is nothing that is read: it may never end.

    :raises InputError: the text cannot be a path at all, or the way to it is closed.
    """
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return "missing"
    except (OSError, ValueError) as error:  # too long, a loop of links, a null character, no permission
        raise InputError(
            f"{path}: not a path that can be followed: {getattr(error, 'strerror', None) or error}"
        ) from None
    return "file" if stat.S_ISREG(mode) else "folder" if stat.S_ISDIR(mode) else "device"
