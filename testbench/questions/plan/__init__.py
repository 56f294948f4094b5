"""How is a flight campaign flown: which points in which order, with which cards, repeats, times and energy?"""
