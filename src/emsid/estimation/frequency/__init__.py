"""Frequency responses from records: of periodic inputs, by local polynomials, by averaged windows."""
