"""Frequency responses of records: windowed, composite, at the lines of multisines; and equivalent models of them."""
