"""Whether what a run says of itself is true: converged, stable, collapse between two loads, no collapse."""
