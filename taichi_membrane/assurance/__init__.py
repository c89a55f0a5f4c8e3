"""What the program is held to: cases with known answers, and sweeps to the border of the safe region."""
