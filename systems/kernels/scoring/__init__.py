"""Compiled numbers about what estimators made: normalised errors, and sums over trials.

May import: systems.kernels.
"""
