"""Studies of studies: comparisons, sweeps, observability.

May import: diagrams.assembly, diagrams.chunks, diagrams.quantities, diagrams.schema, diagrams.statistics,
diagrams.studies, systems, systems.estimators.
"""
