"""Which input, how large and how long, tells the wanted parameters or modes inside the limits?"""
