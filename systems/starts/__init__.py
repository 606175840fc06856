"""How an estimator starts: from a belief, from a port, from its first measurement.

May import: systems, systems.angles, systems.atmosphere, systems.filters, systems.fixes, systems.measurement.
"""
