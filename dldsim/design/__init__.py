"""Search for arrays, their simulation, mask and files."""
