"""Errors, consistency, bounds, intervals: numbers from results, and the blocks and recursions that make them.

May import: diagrams.assembly, diagrams.quantities, diagrams.statistics.paths, systems, systems.estimators,
systems.filters, systems.kernels, systems.measurement, systems.motion.
"""
