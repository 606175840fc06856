"""Parts that one packaged system needs alone.

May import: diagrams.library.fields, diagrams.library.models, diagrams.assembly, diagrams.parts, diagrams.schema,
systems, systems.estimators, systems.measurement, systems.motion, systems.plants, systems.sensors.
"""
