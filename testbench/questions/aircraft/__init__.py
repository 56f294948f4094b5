"""How does an aircraft trim over its speeds, which modes does it have, and where does it flutter?"""
