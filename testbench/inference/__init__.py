"""One evidence: whoever asks what records say asks one likelihood, in which all that is uncertain is uncertain.

:mod:`.parameters` holds the vector and its priors, :mod:`.linear` the evidence of linear models with noise of unknown
size, :mod:`.unknown` the forces that no hypothesis describes, :mod:`.evidence` the table of hypotheses, and
:mod:`.calibrate` finds how far stated probabilities can be trusted by flying the user's own flight again.
"""
