"""Kinds of measurement of a system of one's own, a file each; `quietfix.diagrams.own.fields.sensors` lists them.

May import: diagrams.parts, diagrams.paths, diagrams.quantities, diagrams.schema, systems, systems.angles,
systems.estimators, systems.geometry, systems.measurement.
"""
