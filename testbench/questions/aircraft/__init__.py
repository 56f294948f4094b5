"""How does an aircraft trim over its speeds, which modes has it, where does it flutter?"""
