"""Measured trials: a file becomes a table, the table's columns become quantities, and these become a ``Record``.

Nothing is guessed silently: what was detected and what was assumed is said in the result, and what does not fit the
specification or itself is refused with the mismatch named.
"""
