"""The models: every model is a value that can be simulated, used to predict, printed and saved.

`emsid.models.kinds` knows all of them; it is not imported here, as it takes their searches along.
"""
