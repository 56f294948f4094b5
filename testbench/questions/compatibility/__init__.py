"""Do the instruments of a record agree with each other, and which err by how much?"""
