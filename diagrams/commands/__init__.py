"""The command line: one file per command or group of them; printing, exit status.

May import: diagrams.commands.judging, diagrams.assembly, diagrams.console, diagrams.figures, diagrams.identification,
diagrams.live, diagrams.maps, diagrams.own, diagrams.scale, diagrams.schema, diagrams.statistics, diagrams.studies,
diagrams.writers, diagrams.experiments, systems.
"""
