"""Estimators that take the roots of the ranging equation between two satellites, with their options.

May import: systems, systems.angles, systems.estimators, systems.filters, systems.fixes, systems.measurement,
systems.motion, systems.starts.
"""
