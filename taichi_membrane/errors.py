"""The one exception a user's mistake raises."""

from __future__ import annotations


class InputError(ValueError):
    """Bad input, told in one message: what is wrong, where (file, key, element number), and the values or names allowed.

    The command line prints the message without a traceback and ends with exit code 2.
    """
