"""Maps of the bound: how well a target could be known after the measurements, wherever it is."""
