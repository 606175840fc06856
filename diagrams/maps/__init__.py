"""Maps of the bound: how well a target could be known after the measurements, wherever it is.

May import: diagrams.assembly, diagrams.console, diagrams.parts, diagrams.quantities, diagrams.schema,
diagrams.statistics, systems, systems.angles, systems.earth, systems.estimators, systems.geometry,
systems.measurement, systems.motion, systems.sensors, systems.starts, systems.trajectories.
"""
