"""A user's own classes in a file of YAML: measurement and motion models, plants, parts.

May import: diagrams.own.kinds, diagrams.assembly, diagrams.paths, diagrams.quantities, diagrams.schema, systems,
systems.measurement, systems.motion, systems.plants.
"""
