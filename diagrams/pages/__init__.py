"""Pages to be looked at: a result as one HTML file that needs no network.

May import: diagrams.console, diagrams.figures, diagrams.quantities, diagrams.schema, diagrams.statistics,
diagrams.studies, diagrams.tables, diagrams.writers.
"""
