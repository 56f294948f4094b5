"""How does a flight campaign go: which points in which order, with which cards, repeats, times and energy?"""
