"""How far to trust it: validation, accuracy, stability, reference outcomes."""
