"""The results of the papers, repeated on simulated flights: every printed number beside ours, and why they differ."""
