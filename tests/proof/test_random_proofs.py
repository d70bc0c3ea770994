"""Random loops, slow and fast poles among them: nothing false is said, and what has room is proved."""

import numpy as np
import pytest
from random_proofs import WRONG, judged, posed


@pytest.mark.slow
@pytest.mark.parametrize("number", range(12))
def test_random_loops_are_judged_rightly_and_those_with_room_are_proved(number):
    case = posed(np.random.default_rng([5, number]))
    proof, word, _ = judged(case, seconds=60.0)
    assert word not in WRONG, (proof.why, case.text())
