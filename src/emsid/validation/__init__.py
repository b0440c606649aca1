"""How well a model runs on data that it has not seen."""
