"""A system of a user's own, declared in one YAML file: platforms, a target, sensors, what is believed, estimators."""
