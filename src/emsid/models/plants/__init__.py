"""Physical plants as models of records."""
