"""Blocks from an emitter's samples to TDOA and FDOA: transmitter, receiver, link, cross-ambiguity function.

May import: systems, systems.ambiguity, systems.angles, systems.earth, systems.fixes, systems.geometry, systems.iq,
systems.measurement, systems.trajectories.
"""
