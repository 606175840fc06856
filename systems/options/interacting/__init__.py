"""Filters of several motions that interact, with their options.

May import: systems, systems.biases, systems.estimators, systems.filters, systems.measurement, systems.motion,
systems.options, systems.starts.
"""
