"""BLAS and LAPACK on parts of arrays: in place, by address, and where wanted without Python's lock.

SciPy's wrappers copy what is not contiguous, cost more than the work on small matrices, and hold the lock, so that no two threads
work side by side. These are the same routines, at the addresses that SciPy exports for Cython. Every argument is an address;
numbers of rows are 32-bit integers.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cache
from types import ModuleType

import numpy as np
from scipy.linalg import cython_blas, cython_lapack
from threadpoolctl import ThreadpoolController

_api = ctypes.pythonapi
_api.PyCapsule_GetName.restype, _api.PyCapsule_GetName.argtypes = ctypes.c_char_p, [ctypes.py_object]
_api.PyCapsule_GetPointer.restype = ctypes.c_void_p
_api.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]


class Routines:
    """The routines that a factorisation needs.

    :param release: whether calls give Python's lock away. Handing it over takes longer than the work on a small matrix.
    """

    def __init__(self, *, release: bool) -> None:
        prototype = ctypes.CFUNCTYPE if release else ctypes.PYFUNCTYPE

        def routine(module: ModuleType, name: str, arguments: int) -> Callable[..., None]:
            capsule = module.__pyx_capi__[name]
            signature = _api.PyCapsule_GetName(capsule)
            if signature.count(b",") + 1 != arguments or b"int *" not in signature:
                raise ImportError(
                    f"SciPy's {name} is {signature.decode()}, not of {arguments} addresses and 32-bit integers"
                )
            address = _api.PyCapsule_GetPointer(capsule, signature)
            return prototype(None, *[ctypes.c_void_p] * arguments)(address)

        self.dpotrf = routine(cython_lapack, "dpotrf", 5)
        self.dtrsm = routine(cython_blas, "dtrsm", 11)
        self.dsyrk = routine(cython_blas, "dsyrk", 10)
        self.dtrsv = routine(cython_blas, "dtrsv", 8)
        self.dgemv = routine(cython_blas, "dgemv", 11)


locked, unlocked = Routines(release=False), Routines(release=True)

_letters = np.frombuffer(b"LRNT", dtype=np.uint8).copy()
LOWER, RIGHT, NO, TRANSPOSED = (_letters.ctypes.data + k for k in range(4))
_numbers = np.array([1.0, -1.0])
ONE, MINUS = (_numbers.ctypes.data + 8 * k for k in range(2))
_step = np.ones(1, dtype=np.int32)
STEP = _step.ctypes.data


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


def one_thread() -> AbstractContextManager[object]:
    """Keep each BLAS call to one thread: threads share out the fronts. On fronts of up to 2500 rows a second one was slower, and
    beside other work ten times slower."""
    return _controller().limit(limits=1, user_api="blas")
