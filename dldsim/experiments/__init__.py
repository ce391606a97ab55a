"""What is done with a solver: array runs, assays, recording."""
