"""Covariances that allow for coloured residuals and model error, and parameters that the data do not separate."""
