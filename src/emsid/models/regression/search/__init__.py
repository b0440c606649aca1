"""The choice of orders and terms of regressions by the free run on unseen data."""
