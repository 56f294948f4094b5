"""Parametric estimation: a structure with named parameters, fitted to records by output error and its kin."""
