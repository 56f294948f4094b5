"""The blind test: hidden truths made by code of their own, named by the workflow, and how often it is right."""
