"""Compiled iterations of fixes.

May import: systems.kernels, systems.kernels.models.
"""
