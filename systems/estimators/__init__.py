"""Estimator blocks: the same ports and the same meaning, whatever is inside.

May import: systems, systems.angles, systems.earth, systems.filters, systems.fixes, systems.kernels,
systems.measurement, systems.motion, systems.smoothing, systems.starts.
"""
