"""How a system is declared and built: signals by name, parts that put blocks there, one builder for every system.

May import: diagrams.console, diagrams.quantities, diagrams.readers, diagrams.schema, systems, systems.biases,
systems.estimators, systems.late, systems.measurement, systems.motion, systems.options, systems.starts.
"""
