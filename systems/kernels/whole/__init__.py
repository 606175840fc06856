"""Whole steps of an estimator in one compiled call.

May import: systems.kernels, systems.kernels.recovery.
"""
