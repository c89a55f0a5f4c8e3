"""Parameter studies, scatter and calibration: many runs of one scene, each with settings of its own."""
