"""Linear models with a noise model: state space."""
