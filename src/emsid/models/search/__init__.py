"""What the searches of all families share."""
