"""How choices between models are made."""
