"""Cascades of linear filters and static maps: Wiener–Hammerstein and its relatives."""
