"""What is done with a solver: array runs, constriction, shear, recording."""
