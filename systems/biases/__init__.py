"""Biases of measurements as states: what they add to rows, how they walk, and what a start knows of them.

May import: systems.filters, systems.geometry, systems.kernels, systems.measurement, systems.motion, systems.starts.
"""
