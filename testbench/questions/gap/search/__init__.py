"""Which effect explains the residual: hypotheses screened, fitted and compared by likelihood."""
