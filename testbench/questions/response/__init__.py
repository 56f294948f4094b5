"""The frequency responses of recorded flights, with coherence and random error."""
