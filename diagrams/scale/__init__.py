"""Long studies as commands run them: from where an interrupted run has come to, and by several processes.

May import: diagrams.assembly, diagrams.chunks, diagrams.console, diagrams.experiments, diagrams.schema,
diagrams.statistics, diagrams.studies.
"""
