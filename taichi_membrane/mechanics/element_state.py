"""What the engine hands over: the state of the elements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.arrays import Floats


@dataclass(frozen=True, kw_only=True)
class ElementState:
    """State at every point where strain is sampled, of three-node triangles one each, at the present displacements; stresses and
    strains in fabric axes (warp, weft, shear).

    :param strain: (m, 3); shear is the engineering shear strain.
    :param stress: (m, 3) force per area.
    :param state: (m,) 0 taut, 1 wrinkled, 2 slack.
    :param fold_strain: (m,) largest principal strain stored in folds, zero where taut.
    :param taut_margin: (m,) minor principal trial stress over the fabric's larger modulus; negative where not taut.
    :param slack_margin: (m,) major principal strain; negative where slack.
    """

    strain: Floats
    stress: Floats
    state: NDArray[np.int8]
    fold_strain: Floats
    taut_margin: Floats
    slack_margin: Floats
