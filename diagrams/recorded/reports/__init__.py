"""What a run of a recording tells: tables, notes, figures.

May import: diagrams.recorded.locating, diagrams.recorded.settings, diagrams.assembly, diagrams.console,
diagrams.figures, diagrams.parts, diagrams.quantities, diagrams.readers, diagrams.statistics, diagrams.writers,
systems, systems.angles, systems.earth, systems.estimators, systems.fixes, systems.geometry, systems.measurement.
"""
