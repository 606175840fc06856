"""Particle filters: pure functions over trials and particles.

May import: systems.filters, systems, systems.kernels, systems.measurement, systems.motion.
"""
