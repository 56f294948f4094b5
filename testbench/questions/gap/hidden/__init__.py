"""Hidden truths: what really flies where a believed model is to be tested, told to nobody who names it.

A :class:`~.truth.Truth` is what one changes of model, sensors and commands; :mod:`.entries` makes one of every kind,
by name; :mod:`.flights` flies it and measures what a suite would have read. The tables ``[hidden]`` of gap scenarios
are in :mod:`.kinds`; ..sealed draws the cases of the blind test (tests/studies/blind).

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""
