"""Measurement models of directions: bearings, azimuth and elevation, direction of arrival, phases.

May import: systems, systems.earth, systems.geometry, systems.kernels, systems.measurement, systems.trajectories.
"""
