"""A CasADi function called through buffers: arrays in, arrays out, without a matrix of CasADi's in between."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Buffered:
    """``function`` with dense arguments and results, ready to be called thousands of times.

    Results are overwritten by the next call; matrices are stored by columns, as CasADi does.
    """

    def __init__(self, function: ca.Function) -> None:
        buffer, self._run = function.buffer()
        self._keep: Any = buffer
        self._inputs = [self._room(function.size1_in(k), function.size2_in(k)) for k in range(function.n_in())]
        self._outputs = [self._room(function.size1_out(k), function.size2_out(k)) for k in range(function.n_out())]
        dense = [function.sparsity_in(k).is_dense() for k in range(function.n_in())]
        dense += [function.sparsity_out(k).is_dense() for k in range(function.n_out())]
        if not all(dense):
            message = f"{function.name()} has a sparse argument or result"
            raise ValueError(message)
        for k, room in enumerate(self._inputs):
            self._keep.set_arg(k, memoryview(room.reshape(-1, order="A")))  # type: ignore
        for k, room in enumerate(self._outputs):
            self._keep.set_res(k, memoryview(room.reshape(-1, order="A")))  # type: ignore

    @staticmethod
    def _room(rows: int, columns: int) -> Array:
        return np.zeros((rows, columns), order="F")

    def __call__(self, *arguments: Any) -> list[Array]:
        """Results (rows, columns) for ``arguments``: matrices, columns as vectors (rows,), numbers."""
        for room, argument in zip(self._inputs, arguments, strict=True):
            room[...] = argument[:, None] if isinstance(argument, np.ndarray) and argument.ndim == 1 else argument
        self._run()
        return self._outputs
