"""Proofs: what holds for all times and for every body of a box, with rounding accounted for."""
