"""The search for feedback models without start values."""
