"""What may be set of a recording, and what is made of its data before they enter a diagram.

May import: diagrams.readers, diagrams.schema, systems, systems.ambiguity, systems.earth, systems.fixes,
systems.geometry, systems.measurement, systems.options, systems.sensors.
"""
