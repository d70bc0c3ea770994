"""What Poise is asked: one question a file, with its statement, ``pose`` (pure) and ``solve``."""
