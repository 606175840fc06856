"""The command line: one file per command or group of them; printing, exit status.

May import: diagrams.assembly, diagrams.cloud, diagrams.commands.judging, diagrams.commands.results, diagrams.console,
diagrams.experiments, diagrams.figures, diagrams.identification, diagrams.live, diagrams.maps, diagrams.own,
diagrams.pages, diagrams.scale, diagrams.scenes, diagrams.schema, diagrams.statistics, diagrams.studies,
diagrams.tables, diagrams.writers, systems.
"""
