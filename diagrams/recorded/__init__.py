"""Recorded measurements in the place of a simulated sensor.

May import: diagrams.recorded.locating, diagrams.recorded.reports, diagrams.recorded.settings, diagrams.assembly,
diagrams.parts, diagrams.quantities, diagrams.readers, diagrams.schema, diagrams.studies, systems, systems.ambiguity,
systems.angles, systems.earth, systems.estimators, systems.fixes, systems.geometry, systems.iq, systems.measurement,
systems.motion, systems.options, systems.sensors, systems.starts.
"""
