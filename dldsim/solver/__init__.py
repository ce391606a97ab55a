"""Kernels and the arrays they own: fluid, membrane, coupling, time step."""
