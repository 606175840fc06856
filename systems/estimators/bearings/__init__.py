"""Estimators that locate by bearings alone, from several of them together.

May import: systems, systems.angles, systems.estimators, systems.filters, systems.fixes, systems.measurement,
systems.motion, systems.starts.
"""
