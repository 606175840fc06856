"""From the fields of a system of a user's own to its models and parts.

May import: diagrams.own.classes, diagrams.own.fields, diagrams.own.kinds, diagrams.assembly, diagrams.parts,
diagrams.paths, diagrams.quantities, diagrams.schema, systems, systems.along_track, systems.angles,
systems.atmosphere, systems.biases, systems.estimators, systems.fixes, systems.geometry, systems.measurement,
systems.motion, systems.options, systems.plants, systems.sensors, systems.starts.
"""
