"""One flight experiment: fly, measure, identify, judge. What can this input and these sensors tell?"""
