"""Which modes do outputs show whose input nobody knows, such as a wing in turbulence?"""
