"""What may stand in the file of a system of a user's own.

May import: diagrams.own.classes, diagrams.own.kinds, diagrams.assembly, diagrams.parts, diagrams.paths,
diagrams.quantities, diagrams.schema, systems, systems.options, systems.trajectories.
"""
