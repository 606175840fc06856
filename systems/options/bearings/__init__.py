"""Estimators that locate by bearings alone, with their options.

May import: systems, systems.estimators, systems.filters, systems.fixes, systems.measurement, systems.motion,
systems.starts.
"""
