"""A run: model of a scene, load steps, probes and checks, results."""
