"""How the program chooses between models."""
