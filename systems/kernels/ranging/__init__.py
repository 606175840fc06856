"""Compiled parts of the ranging equation.

May import: systems.kernels.
"""
