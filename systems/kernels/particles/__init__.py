"""Compiled loops over the particles of clouds (trials, n, N): motion, likelihood, moments, resampling.

May import: systems.kernels.
"""
