"""Measured trials: a file becomes a table, its columns become plates and other quantities, and these a ``Record``.

``files`` reads a ``Table``; ``columns`` assigns what it holds, by names or as the user gives it, to ``Plate`` records
and roles; ``contact`` judges the plates one by one, adds them, and compares the sum with the body. Nothing is guessed
silently: what was detected and what was assumed is stated in the result, and what does not fit the specification or
itself is refused with the mismatch named, and with the options that were tried and read it.
"""
