"""The search for the parameters of a plant, and what the records identify."""
