"""What a record can tell before it is flown: the linearised aircraft with free parameters, and Fisher information."""
