"""Estimators: arrays in, arrays out; nothing here knows a motor or a file."""
