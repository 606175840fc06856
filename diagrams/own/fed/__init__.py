"""A system of a user's own that is fed from a table of measurements, and the table that a study writes.

May import: diagrams.own.classes, diagrams.own.declaring, diagrams.own.fields, diagrams.own.kinds, diagrams.assembly,
diagrams.console, diagrams.parts, diagrams.paths, diagrams.quantities, diagrams.readers, diagrams.schema,
diagrams.statistics, diagrams.writers, systems, systems.angles, systems.earth, systems.plants, systems.playback,
systems.sensors.
"""
