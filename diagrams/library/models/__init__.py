"""The models of the packaged systems, as they are and as they are believed.

May import: diagrams.library.fields, diagrams.assembly, diagrams.maps, diagrams.parts, diagrams.schema, systems,
systems.ambiguity, systems.angles, systems.earth, systems.estimators, systems.fixes, systems.geometry,
systems.measurement, systems.motion, systems.plants, systems.starts, systems.trajectories.
"""
