"""From differences that were measured to a place: a table, a system that is fed with it, and its run.

May import: diagrams.recorded.settings, diagrams.own, diagrams.parts, diagrams.paths, diagrams.readers,
diagrams.schema, diagrams.studies, systems.earth, systems.fixes, systems.measurement.
"""
