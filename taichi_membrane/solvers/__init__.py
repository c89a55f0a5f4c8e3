"""Equilibrium of what the mechanics give: relaxation, Newton's method, arc length."""
