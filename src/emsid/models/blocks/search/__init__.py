"""The search for a cascade: topology, orders, delay, starting values, static map."""
