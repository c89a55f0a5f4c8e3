"""Products of vectors of three components and 3×3 matrices, written out.

They give the numbers of Taichi's own matrix functions, which take three times as long to go through and were a third of its Python
pass over all kernels.
"""

from taichi_membrane.device.language import ti


@ti.func
def dot(x, y):
    """x · y"""
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@ti.func
def norm(x):
    """|x|"""
    return ti.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])


@ti.func
def outer(x, y):
    """x ⊗ y, with x along the rows' numbers."""
    return ti.Matrix.rows([x[0] * y, x[1] * y, x[2] * y])


@ti.func
def times(matrix, x):
    """M x"""
    return matrix[:, 0] * x[0] + matrix[:, 1] * x[1] + matrix[:, 2] * x[2]


@ti.func
def transposed_times(matrix, x):
    """Mᵀ x"""
    return matrix[0, :] * x[0] + matrix[1, :] * x[1] + matrix[2, :] * x[2]


@ti.func
def transposed_product(one, other):
    """Aᵀ B"""
    first, second, third = other[0, :], other[1, :], other[2, :]
    return ti.Matrix.rows([one[0, i] * first + one[1, i] * second + one[2, i] * third for i in ti.static(range(3))])


@ti.func
def product(one, other):
    """A B"""
    first, second, third = other[0, :], other[1, :], other[2, :]
    return ti.Matrix.rows([one[i, 0] * first + one[i, 1] * second + one[i, 2] * third for i in ti.static(range(3))])
