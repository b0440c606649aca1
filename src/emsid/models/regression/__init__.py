"""Models that are linear in their parameters: regressors, structures, and their free run."""
