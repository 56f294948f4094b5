"""Teaching exercises: a text, records of an aircraft of each student's own, answers as TOML, and a checker.

An exercise is one module and one text in ``catalogue/``, and one line in :data:`.names.NAMES`. TEACHING.md in this
folder is for the teacher.
"""
