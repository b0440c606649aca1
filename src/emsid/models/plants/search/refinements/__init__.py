"""What real drives add to a plant, each refinement with its starts."""
