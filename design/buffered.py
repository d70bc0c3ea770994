"""A CasADi function called through buffers: arrays in, arrays out, without a matrix of CasADi's in between."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Buffered:
    """``function``, ready to be called thousands of times with arrays ``given`` and returned by name.

    Vectors are (n,), and a dense matrix is its columns one after the other. Results, ``found``, are overwritten by the
    next call, and NaN where CasADi could not evaluate.
    """

    def __init__(self, function: ca.Function) -> None:
        made: Any = function.buffer()  # CasADi's own types ask for an argument that set_arg does not take
        self._buffer, self._run = made
        self._sure = function.is_a("SXFunction")  # an expression in scalars always has a value, NaN among them
        self.given = {function.name_in(k): np.zeros(function.nnz_in(k)) for k in range(function.n_in())}
        self.found = {function.name_out(k): np.zeros(function.nnz_out(k)) for k in range(function.n_out())}
        for k, room in enumerate(self.given.values()):
            self._buffer.set_arg(k, room.data)
        for k, room in enumerate(self.found.values()):
            self._buffer.set_res(k, room.data)

    def __call__(self, **arguments: Any) -> dict[str, Array]:
        """Results by name; arguments that are not named keep what they were."""
        for name, value in arguments.items():
            self.given[name][:] = value
        return self.run()

    def run(self) -> dict[str, Array]:
        """Results by name, for what is ``given``."""
        self._run()
        if not self._sure and self._buffer.ret():
            for room in self.found.values():
                room[:] = np.nan
        return self.found

    def stats(self) -> Any:
        """What CasADi says of the last call."""
        return self._buffer.stats()
