"""Many flights of a JSBSim model at once: the model as a program of plain operations, run for a batch of flights."""
