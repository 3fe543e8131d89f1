"""What JAX's primitives are in C, element by element."""

from collections.abc import Callable

import numpy as np

PRELUDE = """\
#include <math.h>

#ifndef VG_LOCAL
#define VG_LOCAL static
#endif

/* As XLA's: NaN where either is. */
static inline double vg_max(double a, double b) { return a > b || a != a ? a : b; }
static inline double vg_min(double a, double b) { return a < b || a != a ? a : b; }
static inline double vg_sign(double a) { return a != a ? a : (double)((a > 0) - (a < 0)); }
static inline int vg_place(int a, int last) { return a < 0 ? 0 : a > last ? last : a; }
"""
"""What stands before everything that is emitted."""

ELEMENTWISE: dict[str, str] = {
    "abs": "fabs({0})",
    "add": "{0} + {1}",
    "add_any": "{0} + {1}",
    "and": "{0} && {1}",
    "atan2": "atan2({0}, {1})",
    "cbrt": "cbrt({0})",
    "ceil": "ceil({0})",
    "clamp": "vg_min(vg_max({1}, {0}), {2})",
    "copy": "{0}",
    "cos": "cos({0})",
    "div": "{0} / {1}",
    "eq": "{0} == {1}",
    "exp": "exp({0})",
    "exp2": "exp2({0})",
    "expm1": "expm1({0})",
    "floor": "floor({0})",
    "ge": "{0} >= {1}",
    "gt": "{0} > {1}",
    "is_finite": "!!isfinite({0})",
    "le": "{0} <= {1}",
    "le_to": "{0} <= {1}",
    "log": "log({0})",
    "log1p": "log1p({0})",
    "lt": "{0} < {1}",
    "lt_to": "{0} < {1}",
    "max": "vg_max({0}, {1})",
    "min": "vg_min({0}, {1})",
    "mul": "{0} * {1}",
    "ne": "{0} != {1}",
    "neg": "-{0}",
    "not": "!{0}",
    "or": "{0} || {1}",
    "pow": "pow({0}, {1})",
    "select_n": "{0} ? {2} : {1}",
    "sign": "vg_sign({0})",
    "sin": "sin({0})",
    "sqrt": "sqrt({0})",
    "square": "{0} * {0}",
    "stop_gradient": "{0}",
    "sub": "{0} - {1}",
    "tan": "tan({0})",
    "tanh": "tanh({0})",
}
"""Of one value, or of two or three beside each other."""
OF_TRUTH = ("and", "or", "not")
"""Only of truth values: of whole numbers JAX means their bits."""
REDUCTIONS = {
    "reduce_sum": "{0} + {1}",
    "reduce_prod": "{0} * {1}",
    "reduce_max": "vg_max({0}, {1})",
    "reduce_min": "vg_min({0}, {1})",
    "reduce_and": "{0} && {1}",
    "reduce_or": "{0} || {1}",
}
"""One after the other."""
INLINED = {
    "jit": "jaxpr",
    "pjit": "jaxpr",
    "closed_call": "call_jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
    "remat2": "jaxpr",
}
"""Primitives that are other programs, and which of their settings has it."""


def c_type(dtype: np.dtype) -> str:
    """The type in C of a number or a truth value."""
    return "double" if np.issubdtype(dtype, np.floating) else "int"


def literal(value: float | int | bool) -> str:
    """A number in C that is the same double."""
    if isinstance(value, (bool, np.bool_, int, np.integer)):
        return f"({int(value)})" if value < 0 else str(int(value))
    number = float(value)
    if np.isnan(number):
        return "NAN"
    if np.isinf(number):
        return "INFINITY" if number > 0 else "(-INFINITY)"
    return f"({number!r})" if np.signbit(number) else repr(number)


def integer_power(base: str, exponent: int, assign: Callable[[str], str]) -> str:
    """By squares, in the order of multiplications that XLA has."""
    if exponent == 0:
        return "1.0"
    result, left = "", abs(exponent)
    while left:
        if left & 1:
            result = base if not result else assign(f"{result} * {base}")
        left >>= 1
        if left:
            base = assign(f"{base} * {base}")
    return result if exponent > 0 else f"1.0 / {result}"
