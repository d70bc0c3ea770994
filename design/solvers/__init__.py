"""The only doors to solvers. A solver's word is not taken for it: residuals are recomputed at the door."""
