"""From a traced JAX function to straight-line C: every array apart, a variable a number."""

import re
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from vgtjax import InputError

from .arrays import COMPOSED, array_of
from .primitives import ELEMENTWISE, INLINED, OF_TRUTH, REDUCTIONS, c_type, integer_power
from .rearrange import REARRANGED, Names, literals, names


def emit_function(name: str, function: Callable[..., Any], arguments: dict[str, Any]) -> str:
    """A JAX function as one in C.

    **Arguments:**

    - `function`: of as many arrays as there are `arguments`, gives a sequence of numbers.
    - `arguments`: by their names in C an array of one dimension, which comes as a pointer, or a number.

    **Raises:** `InputError` for what no C is known for.
    """
    traced = jax.make_jaxpr(lambda *given: [*function(*given)])(*arguments.values())
    emitter = _Emitter()
    given = [_argument(each, np.ndim(value), np.size(value)) for each, value in arguments.items()]
    results = emitter.program(traced.jaxpr, traced.consts, given)
    emitter.lines += [f"out[{place}] = {number};" for place, each in enumerate(results) for number in each.flat]
    signature = ", ".join(f"const double *{n}" if np.ndim(v) else f"double {n}" for n, v in arguments.items())
    unused = "".join(f"    (void){each};\n" for each in arguments)
    body = "".join(f"    {line}\n" for line in _used(emitter.lines))
    return f"VG_LOCAL void {name}({signature}, double *out) {{\n{unused}{body}}}\n"


def _used(lines: list[str]) -> list[str]:
    """Statements without variables that no later one reads: of an array sometimes only a part is."""
    kept, read = [], set()
    for line in reversed(lines):
        declared = re.match(r"const \w+ (\w+) = ", line)
        if declared is None or declared[1] in read:
            kept.append(line)
            read |= set(re.findall(r"[a-z]\d+", line[declared.end() :] if declared else line))
    return kept[::-1]


def needs(function: Callable[..., Any], arguments: Sequence[Any]) -> list[bool]:
    """Whether what a JAX function gives depends on each of its arguments."""
    program = jax.make_jaxpr(function)(*arguments).jaxpr
    used = {atom for equation in _needed(program) for atom in equation.invars if not hasattr(atom, "val")}
    used |= {atom for atom in program.outvars if not hasattr(atom, "val")}
    return [argument in used for argument in program.invars]


def _argument(name: str, dimensions: int, size: int) -> Names:
    return names([f"{name}[{i}]" for i in range(size)] if dimensions else name)


class _Emitter:
    """Writes the statements of a function, one after the other."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._count = 0

    def program(self, program: Any, constants: Sequence[Any], arguments: Sequence[Names]) -> list[Names]:
        """Writes a program, and gives what it returns."""
        known: dict[Any, Names] = {}
        known.update(zip(program.constvars, map(literals, constants), strict=True))
        known.update(zip(program.invars, arguments, strict=True))

        def read(atom: Any) -> Names:
            return literals(atom.val) if hasattr(atom, "val") else known[atom]

        for equation in _needed(program):
            found = self._equation(equation, [read(atom) for atom in equation.invars])
            known.update(zip(equation.outvars, found, strict=True))
        return [read(atom) for atom in program.outvars]

    def _equation(self, equation: Any, given: list[Names]) -> list[Names]:
        name, settings, out = equation.primitive.name, equation.params, equation.outvars[0].aval
        if name in INLINED:
            return self._inlined(settings[INLINED[name]], given)
        if name == "call_hi_primitive":  # since JAX 0.12; what it expands to is of those below
            shapes = [jax.ShapeDtypeStruct(atom.aval.shape, atom.aval.dtype) for atom in equation.invars]
            return self._inlined(jax.make_jaxpr(settings["_prim"].expand)(*shapes), given)
        if name in ("scan", "while", "cond"):
            return getattr(self, f"_{name}")(given, **settings)
        if name in REARRANGED:
            moved = REARRANGED[name](*given, **settings)
            return moved if isinstance(moved, list) else [moved]
        if name in REDUCTIONS:
            return [self._reduce(REDUCTIONS[name], given[0], settings["axes"], out.dtype)]
        if name in COMPOSED and (found := COMPOSED[name](self, given, equation)) is not None:
            return [found]
        return [self._elementwise(equation, name, given, out)]

    def _inlined(self, inner: Any, given: list[Names]) -> list[Names]:
        return self.program(getattr(inner, "jaxpr", inner), getattr(inner, "consts", ()), given)

    def _elementwise(self, equation: Any, name: str, given: list[Names], out: Any) -> Names:
        kinds = {np.dtype(atom.aval.dtype) for atom in equation.invars}
        if name == "convert_element_type":
            form = "{0} != 0" if out.dtype == bool else f"({c_type(out.dtype)}){{0}}"
        elif name == "integer_pow":
            form = ""
        elif name not in ELEMENTWISE or (name in OF_TRUTH and kinds != {np.dtype(bool)}) or len(given) > 3:
            raise InputError(
                f"no C is known for JAX's primitive '{name}', which is used here; take another component or controller"
            )
        else:
            form = ELEMENTWISE[name]
            if c_type(out.dtype) == "int" and name in ("max", "min", "abs", "clamp", "sign"):
                form = f"(int){form}"  # exact: whole numbers here are places in tables

        def one(*values: str) -> str:
            if name == "integer_pow":
                return self.variable(integer_power(values[0], equation.params["y"], self.variable))
            return self.variable(form.format(*values), c_type(out.dtype))

        rows = np.broadcast_arrays(*given)
        results = [one(*values) for values in zip(*(row.flat for row in rows), strict=True)]
        return names(results).reshape(out.shape)

    def variable(self, expression: str, kind: str = "double") -> str:
        """Writes a variable, and gives its name."""
        name = self.new()
        self.lines.append(f"const {kind} {name} = {expression};")
        return name

    def new(self, letter: str = "t") -> str:
        """A name that is not taken."""
        self._count += 1
        return f"{letter}{self._count}"

    def _reduce(self, form: str, given: Names, axes: Sequence[int], dtype: Any) -> Names:
        last = np.moveaxis(given, axes, range(-len(axes), 0))
        kept = last.shape[: last.ndim - len(axes)]
        rows = last.reshape(-1, int(np.prod(last.shape[len(kept) :])))
        results = []
        for first, *others in rows:
            total = first
            for other in others:
                total = self.variable(form.format(total, other), c_type(dtype))
            results.append(total)
        return names(results).reshape(kept)

    def _mutable(self, start: Names, dtype: Any) -> Names:
        """Variables that a loop or a branch may change."""
        variables = [self.new("m") for _ in start.flat]
        self.lines += [f"{c_type(dtype)} {name} = {value};" for name, value in zip(variables, start.flat, strict=True)]
        return names(variables).reshape(start.shape)

    def _set(self, variables: Sequence[Names], values: Sequence[Names], types: Sequence[Any]) -> None:
        """All at once: a value may be one of the variables."""
        pairs = []
        for variable, value, aval in zip(variables, values, types, strict=True):
            for name, number in zip(variable.flat, np.broadcast_to(value, variable.shape).flat, strict=True):
                kept = self.variable(number, c_type(aval.dtype)) if str(number).startswith("m") else number
                pairs.append(f"{name} = {kept};")
        self.lines += pairs

    def _scan(self, given: list[Names], *, jaxpr: Any, length: int, reverse: bool, **settings: Any) -> list[Names]:
        body, types = jaxpr.jaxpr, jaxpr.out_avals
        num_consts, num_carry = _scanned(settings)
        fixed, begins, series = given[:num_consts], given[num_consts:][:num_carry], given[num_consts + num_carry :]
        state = [self._mutable(each, aval.dtype) for each, aval in zip(begins, types, strict=False)]
        arrays = [
            (array_of(self, each, c_type(var.aval.dtype)), each.shape[1:])
            for each, var in zip(series, body.invars[num_consts + num_carry :], strict=True)
        ]
        kept = [(self.new("a"), aval) for aval in types[num_carry:]]
        self.lines += [f"{c_type(aval.dtype)} {name}[{length * aval.size}];" for name, aval in kept]
        at = self.new("i")
        order = f"{at} = {length} - 1; {at} >= 0; --{at}" if reverse else f"{at} = 0; {at} < {length}; ++{at}"
        self.lines.append(f"for (int {order}) {{")
        inputs = [_row(name, at, shape) for name, shape in arrays]
        results = self.program(body, jaxpr.consts, [*fixed, *state, *inputs])
        for (name, aval), each in zip(kept, results[num_carry:], strict=True):
            places = _row(name, at, aval.shape)
            self.lines += [f"{place} = {number};" for place, number in zip(places.flat, each.flat, strict=True)]
        self._set(state, results[:num_carry], types[:num_carry])
        self.lines.append("}")
        outputs = [
            names([f"{name}[{i}]" for i in range(length * aval.size)]).reshape(length, *aval.shape)
            for name, aval in kept
        ]
        return [*state, *outputs]

    def _while(
        self, given: list[Names], *, cond_jaxpr: Any, body_jaxpr: Any, cond_nconsts: int, body_nconsts: int, **_: Any
    ) -> list[Names]:
        asked, fixed = given[:cond_nconsts], given[cond_nconsts:][:body_nconsts]
        types = body_jaxpr.out_avals
        begins = given[cond_nconsts + body_nconsts :]
        state = [self._mutable(each, aval.dtype) for each, aval in zip(begins, types, strict=True)]
        self.lines.append("for (;;) {")
        (goes_on,) = self.program(cond_jaxpr.jaxpr, cond_jaxpr.consts, [*asked, *state])
        self.lines.append(f"if (!({goes_on.item()})) break;")
        results = self.program(body_jaxpr.jaxpr, body_jaxpr.consts, [*fixed, *state])
        self._set(state, results, types)
        self.lines.append("}")
        return state

    def _cond(self, given: list[Names], *, branches: Any, **_: Any) -> list[Names]:
        which, arguments = given[0].item(), given[1:]
        types = branches[0].out_avals
        state = [self._mutable(names(["0"] * aval.size).reshape(aval.shape), aval.dtype) for aval in types]
        for number, branch in enumerate(branches):
            last = number == len(branches) - 1
            self.lines.append("{" if last else f"if ({which} {'<=' if number == 0 else '=='} {number}) {{")
            self._set(state, self.program(branch.jaxpr, branch.consts, arguments), types)
            self.lines.append("}" if last else "} else")
        return state


def _scanned(settings: dict[str, Any]) -> tuple[int, int]:
    """How many constants a scan has, and how many arrays it carries."""
    if "ft_in" not in settings:  # until JAX 0.10
        return settings["num_consts"], settings["num_carry"]
    constants, carried, _ = settings["ft_in"].unpack()
    return len(constants), len(carried)


def _row(name: str, at: str, shape: tuple[int, ...]) -> Names:
    """A row of an array in C, at a place that is known only there."""
    size = int(np.prod(shape))
    return names([f"{name}[{at} * {size} + {i}]" for i in range(size)]).reshape(shape)


def _needed(program: Any) -> list[Any]:
    """The equations on which a result depends."""
    wanted = {atom for atom in program.outvars if not hasattr(atom, "val")}
    kept = []
    for equation in reversed(program.eqns):
        if any(out in wanted for out in equation.outvars):
            kept.append(equation)
            wanted |= {atom for atom in equation.invars if not hasattr(atom, "val")}
    return kept[::-1]
