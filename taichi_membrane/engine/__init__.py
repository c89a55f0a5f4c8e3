"""Mechanics on the device: fabric, element, membrane, and the solvers relaxation and Newton."""
