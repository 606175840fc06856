"""Parts: each puts one thing on the bus of a diagram under construction; systems are declared with them.

May import: diagrams.assembly, diagrams.readers, diagrams.schema, systems, systems.ambiguity, systems.angles,
systems.biases, systems.earth, systems.estimators, systems.geometry, systems.iq, systems.measurement, systems.motion,
systems.plants, systems.playback, systems.sensors, systems.signal_chain, systems.trajectories.
"""
