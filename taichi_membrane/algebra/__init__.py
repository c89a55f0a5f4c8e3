"""Linear systems: order of elimination, symbolic and numeric factorisation."""
