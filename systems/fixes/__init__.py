"""Fixes: a position from one epoch's measurements, with its covariance.

May import: systems, systems.angles, systems.earth, systems.filters, systems.geometry, systems.kernels,
systems.measurement, systems.trajectories.
"""
