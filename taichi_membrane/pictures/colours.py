"""Colours of states and of scalars, the same in pictures and on the page of a run."""

from __future__ import annotations

import matplotlib
import numpy as np

# Told apart by lightness alone (88, 69, 27 of 100), hence also in grey print and with any colour blindness.
PALETTE = np.array([(0.80, 0.86, 0.93), (0.95, 0.60, 0.16), (0.42, 0.07, 0.22)], np.float32)
# Of forces of cables, told apart from what the surface shows: yellow-green to dark blue.
CABLE_RAMP = matplotlib.colormaps["viridis_r"](np.linspace(0.08, 0.92, 256))[:, :3]
RAMP = matplotlib.colormaps["magma_r"](np.linspace(0.06, 0.88, 256))[:, :3].astype(np.float32)  # cream to dark violet
