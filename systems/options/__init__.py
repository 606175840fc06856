"""What may stand under ``estimators:``; a new one is its file here and a line in `quietfix.systems.registry`."""
