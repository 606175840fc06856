"""A system of a user's own, declared in one YAML file: platforms, a target, sensors, what is believed, estimators.

May import: diagrams.own.classes, diagrams.own.declaring, diagrams.own.fed, diagrams.own.fields, diagrams.own.kinds,
diagrams.assembly, diagrams.parts, diagrams.paths, diagrams.quantities, diagrams.readers, diagrams.schema,
diagrams.writers, systems, systems.estimators, systems.motion, systems.plants.
"""
