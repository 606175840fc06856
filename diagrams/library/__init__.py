"""The packaged systems: each a scenario and what it declares of one.

May import: diagrams.library.fields, diagrams.library.models, diagrams.library.parts, diagrams.assembly,
diagrams.parts, diagrams.quantities, diagrams.schema, systems, systems.angles, systems.biases, systems.estimators,
systems.fixes, systems.geometry, systems.measurement, systems.motion, systems.plants, systems.sensors, systems.starts.
"""
