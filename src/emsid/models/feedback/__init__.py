"""Models with static maps in the feedback of a linear system: see `emsid.models.feedback.model`."""
