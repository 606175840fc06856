"""A kernel as part of a loop over states that stand side by side in memory: one compiled function of each kernel.

Called by its address, a kernel takes five arrays for every state, looks each time whether a derivative is wanted, and
works out again what depends on the platforms alone. Compiled into the loop, with its number of rows known and no place
for a derivative, the compiler leaves out what is not wanted, takes what is the same for all states out of the loop, and
does neighbours several at a time. It does the same arithmetic as the kernel alone does: no bit is another.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from typing import Any

from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from quietfix.systems.kernels.calling import SIGNATURE, by_address, known, packaged
from quietfix.systems.kernels.compiling import compiled, load, part_of_loops

__all__ = ["address_over", "call_over"]

_ROWS = types.Array(types.float64, 2, "C")
_OVER = types.none(_ROWS, types.int64, types.int64, *SIGNATURE.args[1:3], _ROWS, types.int64, types.int64)


def _call(
    typing: Any,
    address: Any,
    states: Any,
    begin: Any,
    end: Any,
    platforms: Any,
    parameters: Any,
    out: Any,
    row: Any,
    place: Any,
) -> Any:
    return by_address(_OVER, (states, begin, end, platforms, parameters, out, row, place))


call_over: Any = intrinsic(_call)
"""Calls the loop at an address: (address, states (n, N), begin, end, platforms, parameters, out, row, place).

What the kernel says of states begin to end goes into the rows of `out` from `row` on, from the column `place` on;
returns whether it raised.
"""


@cache
def address_over(kernel: Any, rows: int) -> int:
    """Return the address of a kernel's loop; see `call_over`.

    Parameters
    ----------
    kernel : str or callable
        As in `quietfix.systems.kernels.equations.Equations`.
    rows : int
        How many rows it writes.
    """
    function = known(kernel)
    made = load(_loop(getattr(function, "py_func", function), rows))
    result = made.overloads[_OVER.args]
    _kept.append(made)
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


_kept: list[Any] = []  # what an address was given of must stay


def _loop(function: Callable[..., Any], rows: int) -> Any:
    careful = not packaged(function)
    once, state_of, value_of, nothing = part_of_loops(function, careful), _column(None), _column(rows), _no_rows

    def over(
        states: Any, begin: int, end: int, platforms: Any, parameters: Any, out: Any, row: int, place: int
    ) -> None:
        none = nothing()
        for j in range(begin, end):
            value = value_of(out, row, place + j - begin)
            for i in range(rows):
                value[i] = 0.0
            once(state_of(states, 0, j), platforms, parameters, value, none)

    # machine code is found by this name
    code = function.__code__
    source = f"{code.co_filename}:{code.co_firstlineno}:{rows}".encode() + code.co_code
    over.__name__ = f"{function.__name__}_over_{rows}"
    over.__qualname__ = f"{function.__qualname__}_{hashlib.sha256(source).hexdigest()[:16]}_over_{rows}"
    made = compiled(_OVER.args, from_python=False, careful=careful, apart=True)(over)
    made.kept_as = function, f"-over-{rows}"
    return made


def _column(rows: int | None) -> Any:
    """Return what makes a state, or so many rows from one on, of a column of a matrix, without a copy."""

    def column(typing: Any, array: Any, row: Any, place: Any) -> Any:
        made = types.Array(types.float64, 1, "A")

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            whole = context.make_array(signature.args[0])(context, builder, args[0])
            count = builder.extract_value(whole.shape, 0) if rows is None else context.get_constant(types.intp, rows)
            length = builder.extract_value(whole.shape, 1)
            step = builder.mul(length, context.get_constant(types.intp, 8))
            first = builder.gep(whole.data, [builder.add(builder.mul(args[1], length), args[2])])
            return _array(context, builder, made, first, [count], [step])

        return made(array, types.intp, types.intp), generate

    return intrinsic(column)


def _nothing(typing: Any) -> Any:
    """Return a derivative without a row: the compiler knows it."""
    made = types.Array(types.float64, 2, "A")

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        null = context.get_value_type(types.CPointer(types.float64))(None)
        none = context.get_constant(types.intp, 0)
        return _array(context, builder, made, null, [none, none], [none, none])

    return made(), generate


_no_rows: Any = intrinsic(_nothing)


def _array(context: Any, builder: Any, made: Any, data: Any, shape: Any, strides: Any) -> Any:
    out = context.make_array(made)(context, builder)
    size = context.get_constant(types.intp, 8)
    populate_array(out, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None)
    return out._getvalue()
