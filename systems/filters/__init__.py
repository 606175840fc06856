"""Estimators as pure functions of (mean, covariance) over leading axes; they know nothing of Drake.

May import: systems, systems.kernels, systems.measurement, systems.motion.
"""
