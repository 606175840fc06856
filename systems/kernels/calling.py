"""The one signature of a kernel, and calls of one by its address."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable
from typing import Any

from numba import types
from numba.core import cgutils
from numba.core.sigutils import normalize_signature
from numba.extending import intrinsic

from quietfix.systems.kernels.compiling import compiled, load

__all__ = [
    "ARGUMENTS",
    "SIGNATURE",
    "UPDATE",
    "address_of",
    "by_address",
    "call_kernel",
    "caller",
    "entry",
    "kernel",
    "known",
    "packaged",
]

ARGUMENTS = ("state", "platforms", "parameters", "value", "jacobian")
SIGNATURE = types.void(
    types.Array(types.float64, 1, "A"),
    types.Array(types.float64, 2, "A"),
    types.Array(types.float64, 1, "A"),
    types.Array(types.float64, 1, "A"),
    types.Array(types.float64, 2, "A"),
)
UPDATE = (
    "int64(float64[:,::1],float64[:,:,::1],float64[:,::1],float64[:,:,::1],float64[:,:,::1],"
    "int64[:,::1],int64[::1],float64[::1],float64[::1],float64[::1],float64[::1],"
    "float64[:,::1],float64[:,:,::1],float64[:,::1],float64[::1],float64[::1])"
)
"""Of every filter's update; see `quietfix.systems.kernels.extended.update`."""
_kept: dict[Any, Any] = {}  # what an address was given of must stay


def kernel(function: Callable[..., Any]) -> Any:
    """Decorate the equations of a model for one state: ``f(state, platforms, parameters, value, jacobian)``.

    It is compiled by numba when it is first needed, and writes its rows into `value` (m,) and their derivatives into
    `jacobian` (m, n), which come filled with zeros; without a row where only the value is asked for. `state` is
    (n,), `platforms` (p, 6), `parameters` what the model says. None of the three is to be written to: `state` is where
    an estimator has it, and what is written there spoils that trial, though no other.

    Raises
    ------
    TypeError
        If it is not a function of five arguments.
    """
    _check_arguments(function)
    return compiled(SIGNATURE.args, from_python=False, careful=not packaged(function))(function)


def packaged(function: Callable[..., Any]) -> bool:
    """Return whether a kernel is ours; a user's may allocate, and is checked for indices beyond the end of an array."""
    return function.__module__.startswith("quietfix.systems.kernels.")


def _check_arguments(function: Callable[..., Any]) -> None:
    name = getattr(function, "__name__", repr(function))
    if not inspect.isfunction(function):
        raise TypeError(f"kernel: {name} is not allowed; a plain function of {', '.join(ARGUMENTS)}")
    given = list(inspect.signature(function).parameters.values())
    if len(given) != len(ARGUMENTS) or any(p.kind is not p.POSITIONAL_OR_KEYWORD for p in given):
        got = ", ".join(map(str, given))
        raise TypeError(f"kernel: {name}({got}) is not allowed; its arguments must be {', '.join(ARGUMENTS)}")


def known(kernel: Any) -> Any:
    """Return a kernel: that of ``module:function`` of the room `models`, or a user's function itself."""
    if isinstance(kernel, str):
        module, _, name = kernel.partition(":")
        kernel = getattr(importlib.import_module(f"quietfix.systems.kernels.models.{module}"), name)
    return kernel


def address_of(function: Any) -> int:
    """Return the address of a kernel's machine code in this process; never store it: it is another in the next.

    Raises
    ------
    TypeError
        If it is not a `kernel`, cannot be compiled, or returns something: called by address, it would bring down the
        process.
    """
    plain = getattr(function, "py_func", function)
    _check_arguments(plain)
    if plain not in _kept:
        _kept[plain] = function if getattr(function, "declared", None) == SIGNATURE.args else kernel(plain)
    dispatcher, name = _kept[plain], plain.__name__
    try:
        load(dispatcher)
    except Exception as error:  # numba has many of them
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        told = [line for line in lines if not line.startswith("Failed in")]  # a heading that says nothing
        reason = (told or lines or [type(error).__name__])[0]
        raise TypeError(f"kernel: {name} cannot be compiled: {reason}") from error
    result = dispatcher.overloads[SIGNATURE.args]
    if result.signature.return_type != types.none:
        raise TypeError(f"kernel: {name} returns {result.signature.return_type}; it must return nothing")
    return entry(dispatcher)


def entry(dispatcher: Any) -> int:
    """Return the address in this process of a `compiled` function that is loaded, for `by_address`."""
    result = dispatcher.overloads[dispatcher.declared_types]
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


def by_address(signature: Any, given: tuple[Any, ...]) -> Any:
    """Return type and code of a call of a function of that signature: its address, then `given` arguments.

    It is true where the function raised.
    """

    def generate(context: Any, builder: Any, _: Any, args: Any) -> Any:
        convention = context.call_conv
        function = convention.get_function_type(signature.return_type, signature.args)
        pointer = builder.inttoptr(args[0], function.as_pointer())
        cast = [
            context.cast(builder, arg, own, declared)
            for arg, own, declared in zip(args[1:], given, signature.args, strict=True)
        ]
        status, _ = convention.call_function(builder, pointer, signature.return_type, signature.args, cast)
        return status.is_error

    return types.boolean(types.int64, *given), generate


def caller(text: str) -> Any:
    """Return what calls, from compiled code, a function of that signature: (its address, a tuple of its arguments).

    Several functions are then called by the same code, and none is compiled anew into what calls it.
    """
    arguments, result = normalize_signature(text)

    def call(typing: Any, address: Any, given: Any) -> Any:
        def generate(context: Any, builder: Any, _: Any, args: Any) -> Any:
            convention = context.call_conv
            function = convention.get_function_type(result, arguments)
            cast = [
                context.cast(builder, builder.extract_value(args[1], k), own, declared)
                for k, (own, declared) in enumerate(zip(given, arguments, strict=True))
            ]
            pointer = builder.inttoptr(args[0], function.as_pointer())
            status, answer = convention.call_function(builder, pointer, result, arguments, cast)
            with cgutils.if_unlikely(builder, status.is_error):
                convention.return_status_propagate(builder, status)
            return answer

        return result(types.int64, given), generate

    return intrinsic(call)


def _call(typing: Any, address: Any, state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> Any:
    return by_address(SIGNATURE, (state, platforms, parameters, value, jacobian))


call_kernel: Any = intrinsic(_call)
"""Calls the kernel at an address, from compiled code; returns whether it raised."""
