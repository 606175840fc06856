"""Studies of studies: comparisons, sweeps, observability.

May import: diagrams.assembly, diagrams.quantities, diagrams.schema, diagrams.statistics, diagrams.studies, systems,
systems.estimators.
"""
