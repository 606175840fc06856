"""Where things are: movers of a user's file, and the functions of time that they stand for.

May import: diagrams.parts, diagrams.quantities, diagrams.readers, diagrams.schema, systems, systems.earth,
systems.plants, systems.trajectories.
"""
