"""A checker of certificates: it reads a spec's text and a certificate, and shares no code with the prover.

Read in this order: ``balls`` (arithmetic), ``world`` (what the spec says), ``linear`` (poles and contraction, exact),
``tube`` (contact at every time), ``verdict`` (the certificate as a whole). It imports the standard library only.
"""


class Refused(Exception):
    """The certificate does not show what it claims; the text says why."""


class Malformed(Exception):
    """What was read is no certificate: a name or a number is not one, or not of a size that has a meaning here."""


def need(kept: bool, why: str) -> None:
    """Refuse, and say ``why``, unless it is ``kept``."""
    if not kept:
        raise Refused(why)
