"""Files of a run, and reading them back."""
