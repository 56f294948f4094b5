"""What is in a flight log, and where are its manoeuvres?"""
