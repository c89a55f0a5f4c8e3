"""Off-screen pictures of a run, and its curve."""
