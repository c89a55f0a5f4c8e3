"""One process at a time writes in the folder of a run or study: a lock that the system takes back from a process that dies."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from taichi_membrane.errors import InputError

LOCK = ".lock"
# Windows locks bytes, and against reading as well: one far behind the number that the file holds.
_LOCKED_BYTE = 1 << 20
_TAKEN = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK)


@contextmanager
def sole_writer(directory: Path, kind: str = "run") -> Iterator[None]:
    """Keep other processes that ask for the same out of a folder.

    The folder is made where it is missing, and gone again if nothing was put into it. The file that is locked holds the number of
    the process; it is removed at the end, but the lock does not depend on that.

    :param kind: what writes there, ``run`` or ``study``, for the message to the second one.
    :raises InputError: another process is at work there; the folder cannot be made, written or locked.
    """
    missing = [one for one in (directory, *directory.parents) if not one.exists()]
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{directory}: the output folder cannot be made: {error.strerror}") from error
    path = directory / LOCK
    try:
        descriptor = _taken(path, kind)
        try:
            yield
        finally:
            _give_back(path, descriptor)
    finally:
        with suppress(OSError):  # the first that is not empty
            for one in missing:
                one.rmdir()


def _taken(path: Path, kind: str) -> int:
    """Descriptor of the locked file, with the number of this process in it."""
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        try:
            _lock(path, descriptor, kind)
            if _is_file_at(path, descriptor):  # and not one that its last holder has just removed
                os.ftruncate(descriptor, 0)
                os.write(descriptor, str(os.getpid()).encode())
                return descriptor
        except OSError as error:
            os.close(descriptor)
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def _lock(path: Path, descriptor: int, kind: str) -> None:
    """Lock an open file, or tell who has it."""
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
            os.lseek(descriptor, 0, os.SEEK_SET)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in _TAKEN:
            raise InputError(
                f"{path.parent}: the output folder cannot be locked against others ({error.strerror}); give one on "
                "another file system"
            ) from error
        os.lseek(descriptor, 0, os.SEEK_SET)
        holder = os.read(descriptor, 32).decode(errors="replace") or "unknown"
        raise InputError(
            f"{path.parent}: another {kind} writes in this folder (process {holder}); wait for it or end it, or give another "
            "folder"
        ) from error


def _give_back(path: Path, descriptor: int) -> None:
    """Remove the file and unlock it; Windows removes no file that is open."""
    ours = _is_file_at(path, descriptor)
    if sys.platform == "win32":
        os.close(descriptor)
    with suppress(OSError):
        if ours:
            path.unlink()
    if sys.platform != "win32":
        os.close(descriptor)


def _is_file_at(path: Path, descriptor: int) -> bool:
    """Whether an open file is the one at a path."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except OSError:
        return False
