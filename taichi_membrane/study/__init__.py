"""Error against run time: a grid of settings, a fresh process for each, what is gained for the time."""
