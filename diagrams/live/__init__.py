"""Measurements that come one by one, at once or in real time: lines in, estimates out, tick by tick.

May import: diagrams.assembly, diagrams.own, diagrams.parts, diagrams.readers, diagrams.schema, diagrams.studies,
diagrams.writers, systems, systems.estimators, systems.sensors.
"""
