"""The papers' results once more, on simulated flights: every printed number beside ours, and why they part."""
