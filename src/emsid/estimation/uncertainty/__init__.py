"""Covariances that allow for coloured residuals and model error, and what data cannot tell apart."""
