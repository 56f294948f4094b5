"""Which modes do outputs show if nobody knows the input, as of a wing in turbulence?"""
