"""One flight experiment: fly, measure, identify, judge. What do this input and these sensors tell?"""
