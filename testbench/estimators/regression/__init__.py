"""Regression on measured signals: smoothing and differentiation, and global models of the coefficients."""
