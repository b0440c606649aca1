"""Compiled kernels as C99: the functions that a call reaches, written from their source.

The kernels are restricted Python: numbers, arrays, tuples, loops. An argument of the call is known, as the constants of
a plant are, or an array of C. What is known is computed here: branches that it decides disappear, tables are written
where an index is not known. The other statements stay as they are, so the numbers in double precision are those of the
kernel; of a division of whole numbers, none may be negative. A function is written once for every set of known
arguments and shapes; whole numbers and zero count as known, other real numbers do not.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import operator
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.c_form import number
from emsid.models.traced import Traced, text_of

REAL, INT = "real", "int"
DECLARED = {"float": (REAL,), "int": (INT,), "bool": (INT,), "None": ()}
"""The kinds of what a function returns, by its annotation."""
MACROS = {
    **{
        getattr(np, name): name.upper().replace("ARC", "A")
        for name in ("exp", "expm1", "log", "log1p", "sin", "cos", "tanh", "arctan", "arctanh", "floor", "ceil", "sqrt")
    },
    np.abs: "FABS",
    abs: "FABS",
    np.sign: "sign_of",
    np.isnan: "isnan",
    np.isfinite: "isfinite",
}
NEW = (np.empty, np.zeros, np.full)
ARITHMETIC: dict[type[ast.operator], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Add: ("+", operator.add),
    ast.Sub: ("-", operator.sub),
    ast.Mult: ("*", operator.mul),
    ast.Div: ("/", operator.truediv),
    ast.FloorDiv: ("/", operator.floordiv),
    ast.Mod: ("%", operator.mod),
    ast.Pow: ("", operator.pow),
}
COMPARED: dict[type[ast.cmpop], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Lt: ("<", operator.lt),
    ast.LtE: ("<=", operator.le),
    ast.Gt: (">", operator.gt),
    ast.GtE: (">=", operator.ge),
    ast.Eq: ("==", operator.eq),
    ast.NotEq: ("!=", operator.ne),
}
RESERVED = frozenset(
    """auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while real""".split()  # noqa: SIM905
)
"""Words of C that are no names."""


@dataclass(frozen=True)
class Text:
    """A number in C."""

    kind: str
    text: str


@dataclass(frozen=True)
class View:
    """An array in C.

    Attributes:
        base: a pointer.
        shape: its lengths, known or not.
        kind: of its elements.
        offset: of its first element.
        strides: of its axes; None for one after the other.
        constant: whether it cannot be written to.
    """

    base: str
    shape: tuple[Any, ...]
    kind: str = REAL
    offset: Any = 0
    strides: tuple[int, ...] | None = None
    constant: bool = False

    @property
    def steps(self) -> tuple[int, ...]:
        """The strides."""
        if self.strides is not None:
            return self.strides
        return tuple(int(np.prod(self.shape[k + 1 :], dtype=int)) for k in range(len(self.shape)))


class _Refused(Exception):
    """A statement that has no form in C."""


def is_known(value: Any) -> bool:
    """Whether a value does not depend on C; an array of `Traced` counts as known until an element is taken."""
    return all(map(is_known, value)) if isinstance(value, tuple) else not _in_c(value)


def _in_c(value: Any) -> bool:
    return isinstance(value, (Text, View))


def _tuple_of(value: Any, parts: Iterable[Any]) -> Any:
    return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)


def as_text(value: Any, kind: str | None = None) -> str:
    """A number of a kind in C; by default of its own."""
    if type(value) is Traced:
        raise _Refused(f"{value} is computed from parameters")
    if isinstance(value, Text):
        return f"(real){value.text}" if kind == REAL and value.kind == INT else value.text
    if (kind or kind_of(value)) == REAL:
        return number(float(value))
    return str(int(value)) if value >= 0 else f"({int(value)})"


def kind_of(value: Any) -> str:
    """The kind of a number."""
    if isinstance(value, Text):
        return value.kind
    return INT if isinstance(value, (bool, int, np.bool_, np.integer)) else REAL


def bare(text: str) -> str:
    """An expression without the brackets around all of it."""
    depth = 0
    for k, sign in enumerate(text):
        depth += (sign == "(") - (sign == ")")
        if depth == 0 and k + 1 < len(text):
            return text
    return text[1:-1] if text[:1] == "(" and not text.startswith("(-K(") else text


class Writer:
    """Functions in C, and the tables that they read, collected from calls of kernels.

    Where known numbers are `Traced`, they are elements of an array, which every function takes as ``numbers``.

    Attributes:
        tables: by name.
        traced: the elements of ``numbers``.
    """

    def __init__(self, numbers: Mapping[str, float] | None = None, *, traces: bool = False) -> None:
        """
        Args:
            numbers: in place of constants of modules, by name.
            traces: whether known numbers may be `Traced`.
        """
        self.numbers, self.traces = numbers or {}, traces
        self.tables: dict[str, NDArray[Any]] = {}
        self.traced: list[Any] = []
        self._places: dict[Any, int] = {}
        self._names: dict[Any, str] = {}
        self._written: dict[Any, _Function] = {}
        self._taken: Counter[str] = Counter()

    def call(self, kernel: Any, *arguments: Any) -> str:
        """The expression that calls a kernel, whose functions are written.

        Raises:
            ModelError: for a function that is not compiled, or a statement that has no form in C.
        """
        try:
            return as_text(_Function(self, kernel, (), "").calling(kernel, arguments))
        except _Refused as problem:
            raise ModelError(f"{problem}, which has no form in C") from None

    @property
    def functions(self) -> str:
        """All that are called, in an order in which C takes them."""
        found = list(self._written.values())
        called = {name for each in found for name in each.called} | {each.name for each in found if each.is_first}
        return "\n".join(each.whole for each in found if each.name in called)

    def table(self, values: NDArray[Any], hint: str) -> View:
        """A table of known numbers."""
        if values.dtype == object:
            return View("numbers", values.shape, offset=self._place(values.ravel().tolist()), constant=True)
        key = known_key(values)
        if key not in self._names:
            self._names[key] = self.free(f"table_{hint.strip('_')}")
            whole = values.dtype.kind in "biu"
            self.tables[self._names[key]] = values.ravel().astype(np.int64 if whole else float)
        return View(self._names[key], values.shape, INT if values.dtype.kind in "biu" else REAL, constant=True)

    def _place(self, values: Sequence[Any]) -> int:
        """Where ``numbers`` has these values, one after the other."""
        texts = tuple(map(text_of, values))
        if texts not in self._places:
            self._places[texts] = len(self.traced)
            self.traced += values
        return self._places[texts]

    def lifted(self, value: Any) -> Any:
        """A value as it is in C where it is `Traced`, or a tuple with such numbers."""
        if not self.traces:
            return value
        if type(value) is Traced:
            return Text(REAL, f"numbers[{self._place([value])}]")
        return _tuple_of(value, map(self.lifted, value)) if isinstance(value, tuple) else value

    def free(self, name: str) -> str:
        """A name that nothing else has."""
        self._taken[name] += 1
        return name if self._taken[name] == 1 else f"{name}_{self._taken[name]}"

    def function(self, kernel: Any, formal: Sequence[Any], key: Any) -> _Function:
        """The function for a kernel and its arguments, written where it is not yet."""
        key = (kernel, key)
        if key not in self._written:
            name = self.free(kernel.py_func.__code__.co_name.strip("_"))
            made = _Function(self, kernel, formal, name)
            made.write()
            self._written[key] = made
        return self._written[key]


def known_key(value: Any) -> Any:
    """What tells two known values from each other."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, tuple):
        return type(value), tuple(map(known_key, value))
    return (type(value), repr(value)) if isinstance(value, (int, float, np.generic)) else value


def _source(kernel: Any) -> ast.FunctionDef:
    """The definition of a function."""
    if not hasattr(kernel, "py_func"):
        raise _Refused(f"{getattr(kernel, '__name__', kernel)} is not compiled")
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(kernel.py_func.__code__))).body[0]
    except (OSError, TypeError, SyntaxError):
        raise _Refused(f"the source of {kernel.py_func.__name__} is not known") from None
    if not isinstance(tree, ast.FunctionDef):
        raise _Refused(f"{kernel.py_func.__name__} is no function")
    return tree


class _Function:
    """A function of C, written from that of Python for some arguments."""

    def __init__(self, writer: Writer, kernel: Any, formal: Sequence[Any], name: str) -> None:
        self.writer, self.kernel, self.name, self.formal = writer, kernel, name, formal
        self.called: set[str] = set()
        self.is_first, self.whole = False, ""
        self.kinds: dict[str, str] = {}
        if name:
            self.tree = _source(kernel)
            self.assigned = Counter(
                node.id
                for node in ast.walk(self.tree)
                if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
            )
            self.assigned.update(arg.arg for arg in self.tree.args.args)
            self.assigned.update(
                node.target.id
                for node in ast.walk(self.tree)
                if isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name)
            )
            self.returned = _returned(self.tree) or ()

    # --- the whole

    def write(self) -> None:
        """Write it; again until the kind of every variable is that of all its values."""
        kinds: dict[str, str] | None = None
        while kinds != self.kinds:
            kinds = dict(self.kinds)
            self.env: dict[str, Any] = {}
            self.lines: list[str] = []
            self.arrays: dict[str, tuple[str, int]] = {}
            self.pointers: dict[str, str] = {}
            self.scalars: list[str] = []
            self.depth, self.called, self.fresh = 1, set(), Counter[str]()
            self.given: set[str] = set()
            self.arrays_given: set[str] = set()
            parameters: list[tuple[str, str]] = []
            for arg, value in zip(self.tree.args.args, self.formal, strict=True):
                self.env[arg.arg] = self._parameter(arg.arg, value, parameters)
            self.block(self.tree.body)
        self._assemble(parameters)

    def _parameter(self, name: str, value: Any, parameters: list[tuple[str, str]]) -> Any:
        """What a parameter is in the body, and its declaration."""
        if isinstance(value, tuple) and not is_known(value):
            fields = getattr(value, "_fields", range(len(value)))
            return _tuple_of(
                value, (self._parameter(f"{name}_{f}", v, parameters) for f, v in zip(fields, value, strict=True))
            )
        own = self._own(name)
        if isinstance(value, Text):
            parameters.append((value.kind, own))
            self.given.add(own)
            self.kinds[own] = value.kind
            return Text(value.kind, own)
        if isinstance(value, View):
            self.arrays_given.add(own)
            parameters.append((f"{'const ' * value.constant}{value.kind} *", own))
            shape = []
            for k, length in enumerate(value.shape):
                shape.append(Text(INT, f"{own}_n{k}") if _in_c(length) else length)
                parameters += [(INT, f"{own}_n{k}")] * _in_c(length)
            return View(own, tuple(shape), value.kind, 0, value.strides, value.constant)
        if self.assigned[name] > 1:  # it is known, but changes
            self.lines.append(f"    {own} = {as_text(value)};")
            self._declare(own, kind_of(value))
            return Text(kind_of(value), own)
        return value

    def _assemble(self, parameters: list[tuple[str, str]]) -> None:
        """Put declarations before the statements."""
        parameters = [*[("const real *", "numbers")] * self.writer.traces, *parameters] + [
            (f"{kind} *", f"result_{k}") for k, kind in enumerate(self.returned) if len(self.returned) > 1
        ]
        body = "\n".join(self.lines)
        read = Counter(re.findall(r"[A-Za-z_]\w*", re.sub(r"(?m)^ *(\w+) = ", "", body)))
        head = [f"    {self.kinds[name]} {name} = {as_text(0, self.kinds[name])};" for name in self.scalars]
        head += [f"    {kind} {name}[{max(size, 1)}];" for name, (kind, size) in self.arrays.items()]
        head += [f"    {kind} {name} = 0;" for name, kind in self.pointers.items()]
        names = [*(name for _, name in parameters), *self.scalars, *self.arrays, *self.pointers]
        head += [f"    (void){name};" for name in names if not read[name]]
        declared = ", ".join(f"{kind}{'' if kind.endswith('*') else ' '}{name}" for kind, name in parameters)
        result = self.returned[0] if len(self.returned) == 1 else "void"
        about = re.sub(r"`+", "", " ".join((ast.get_docstring(self.tree) or "").split("\n\n")[0].split()))
        comment = f"/* {about} */\n" if about and "*/" not in about else ""
        self.whole = (
            f"{comment}static {result} {self.name}({declared or 'void'})\n{{\n" + "\n".join([*head, body]) + "\n}\n"
        )

    def _own(self, name: str) -> str:
        """A name in C."""
        return f"{name}_" if name in RESERVED or name == self.name else name

    def _declare(self, name: str, kind: str) -> Text:
        """A variable of a kind that takes this one."""
        if name not in self.scalars and name not in self.given:
            self.scalars.append(name)
        self.kinds[name] = REAL if REAL in (kind, self.kinds.get(name)) else INT
        return Text(self.kinds[name], name)

    def _new(self, hint: str) -> str:
        self.fresh[hint] += 1
        return f"{hint}_{self.fresh[hint]}"

    def say(self, line: str) -> None:
        """Write a line."""
        self.lines.append("    " * self.depth + line)

    # --- statements

    def block(self, body: Sequence[ast.stmt]) -> bool:
        """Write statements; whether what follows is not reached."""
        return any(self.statement(each) for each in body)

    def statement(self, s: ast.stmt) -> bool:
        """Write one statement; whether what follows it is not reached."""
        match s:
            case ast.Expr(ast.Constant()) | ast.Pass():
                return False
            case ast.Expr(value):
                self.say(f"{as_text(self.of(value))};")
            case ast.Assign(targets, value):
                found = self.of(value, targets[0])
                self.assign([(target, found) for target in targets])
            case ast.AugAssign(target, op, value):
                self._place_of(target, self._calculated(op, self.of(_loaded(target)), self.of(value)), say=True)
            case ast.Return(value):
                self._return(None if value is None else self.of(value))
                return True
            case ast.Break() | ast.Continue():
                self.say("break;" if isinstance(s, ast.Break) else "continue;")
                return True
            case ast.If(test, yes, no):
                return self._if(self.of(test), yes, no)
            case ast.While(test, body):
                self._while(test, body)
            case ast.For(target, over, body):
                self._for(target, over, body)
            case _:
                raise _Refused(f"{self._where(s)} has the statement {ast.unparse(s).splitlines()[0]!r}")
        return False

    def _where(self, node: ast.AST) -> str:
        return f"line {getattr(node, 'lineno', 0)} of {self.kernel.py_func.__name__}"

    def _if(self, test: Any, yes: Sequence[ast.stmt], no: Sequence[ast.stmt]) -> bool:
        if not _in_c(test):
            return self.block(yes if test else no)
        self.say(f"if ({bare(as_text(test))}) {{")
        ends = self._inner(yes)
        if no:
            self.say("} else {")
            ends = self._inner(no) and ends
        self.say("}")
        return ends and bool(no)

    def _inner(self, body: Sequence[ast.stmt]) -> bool:
        self.depth += 1
        ends = self.block(body)
        self.depth -= 1
        return ends

    def _while(self, test: ast.expr, body: Sequence[ast.stmt]) -> None:
        self.say("for (;;) {")
        self.depth += 1
        asked = self.of(test)
        if _in_c(asked):
            self.say(f"if (!{as_text(asked)}) {{")
            self.say("    break;")
            self.say("}")
        self.block(body)
        self.depth -= 1
        self.say("}")

    def _for(self, target: ast.expr, over: ast.expr, body: Sequence[ast.stmt]) -> None:
        if not isinstance(target, ast.Name):
            raise _Refused(f"{self._where(target)} has a loop over pairs")
        name = self._new("loop") if target.id == "_" else self._own(target.id)
        if isinstance(over, ast.Call) and self.of(over.func) is range:
            begin, end, step = self._range([self.of(each) for each in over.args], body)
            if all(map(is_known, (begin, end))) and not len(range(begin, end, step)):
                return
            variable = self._declare(name, INT)
            turn = f"{name} += {step}" if step > 0 else f"{name} -= {-step}"
            self.say(f"for ({name} = {as_text(begin)}; {name} {'<' if step > 0 else '>'} {as_text(end)}; {turn}) {{")
        else:
            values = self.of(over)
            if not is_known(values):
                raise _Refused(f"{self._where(over)} has a loop over numbers that are not known")
            listed, at = self.writer.table(np.asarray(values), name), self._new("loop")
            if not len(values):
                return
            self._declare(at, INT)
            variable = self._declare(name, listed.kind)
            self.say(f"for ({at} = 0; {at} < {len(values)}; {at} += 1) {{")
            self.say(f"    {name} = {listed.base}[{at}];")
        if target.id != "_":
            self.env[target.id] = variable
        self._inner(body)
        self.say("}")

    def _range(self, values: list[Any], body: Sequence[ast.stmt]) -> tuple[Any, Any, int]:
        """Begin, end and step; an end that the body changes is kept before."""
        begin, end = (0, values[0]) if len(values) == 1 else values[:2]
        step = values[2] if len(values) > 2 else 1
        changed = {
            self._own(node.id)
            for part in body
            for node in ast.walk(part)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        }
        if isinstance(end, Text) and changed & set(re.findall(r"\w+", end.text)):
            kept = self._declare(self._new("end"), INT)
            self.say(f"{kept.text} = {end.text};")
            end = kept
        return begin, end, int(step)

    def _return(self, value: Any) -> None:
        if len(self.returned) > 1:
            for k, (kind, each) in enumerate(zip(self.returned, value, strict=True)):
                self.say(f"*result_{k} = {as_text(each, kind)};")
        single = f" {bare(as_text(value, self.returned[0]))}" if len(self.returned) == 1 else ""
        self.say(f"return{single};")

    # --- assignments

    def assign(self, pairs: list[tuple[ast.expr, Any]]) -> None:
        """Assign values to targets, all at once."""
        flat: list[tuple[ast.expr, Any]] = []
        for target, value in pairs:
            if isinstance(target, ast.Tuple):
                flat += zip(target.elts, value, strict=True)
            else:
                flat.append((target, value))
        if any(isinstance(target, ast.Tuple) for target, _ in flat):
            return self.assign(flat)
        placed: list[tuple[str, str]] = []
        for target, value in flat:
            placed += self._place_of(target, value)
        bases = [re.match(r"[*(]*(?:s->)?(\w+)", place) for place, _ in placed]
        crossing = any(
            base and re.search(rf"\b{base[1]}\b", text) for k, base in enumerate(bases) for _, text in placed[k + 1 :]
        )
        if crossing:
            kept = [self._kept(text, place) for place, text in placed]
            placed = [(place, name) for (place, _), name in zip(placed, kept, strict=True)]
        for place, text in placed:
            self.say(f"{place} = {bare(text)};")
        return None

    def _kept(self, text: str, place: str) -> str:
        """A variable with a value; of the kind of its place, which all places but variables have as real."""
        kind = self.kinds.get(place, REAL)
        name = self._declare(self._new("kept"), kind).text
        self.say(f"{name} = {text};")
        return name

    def _place_of(self, target: ast.expr, value: Any, say: bool = False) -> list[tuple[str, str]]:
        """The places in C that a value goes to, and what goes there; none where the name stands for the value."""
        found: list[tuple[str, str]] = []
        match target:
            case ast.Name(name):
                found = self._named(name, value)
            case ast.Subscript():
                place = self.of(_loaded(target))
                if isinstance(place, Text):
                    found = [(place.text, as_text(value, place.kind))]
                else:
                    self._fill(place, value)
            case _:
                raise _Refused(f"{self._where(target)} assigns to {ast.unparse(target)}")
        if say:
            for place, text in found:
                self.say(f"{place} = {bare(text)};")
        return found

    def _named(self, name: str, value: Any) -> list[tuple[str, str]]:
        """See `_place_of`, for a name."""
        own = self._own(name)
        if isinstance(value, tuple) and not (is_known(value) and self.assigned[name] == 1):
            parts = [self._part(name, k, each) for k, each in enumerate(value)]
            self.env[name] = _tuple_of(value, (variable for variable, _ in parts))
            return [pair for _, pairs in parts for pair in pairs]
        if isinstance(value, View):
            if self.assigned[name] > 1:
                raise _Refused(f"{self.kernel.py_func.__name__} assigns to the array {name} twice")
            if not is_known(value.offset):
                self.pointers[own] = f"{'const ' * value.constant}{value.kind} *"
                self.say(f"{own} = {self._pointer(value)};")
                value = View(own, value.shape, value.kind, 0, value.strides, value.constant)
            self.env[name] = value
            return []
        if self.assigned[name] == 1 and not _in_c(value):
            self.env[name] = value
            return []
        if not isinstance(value, (Text, int, float, np.generic)):
            raise _Refused(f"{self.kernel.py_func.__name__} assigns to {name} twice")
        own += "_" * (own in self.arrays_given)  # a parameter that was an array
        variable = self.env[name] = self._declare(own, kind_of(value))
        return [(own, as_text(value, variable.kind))]

    def _part(self, name: str, k: int, value: Any) -> tuple[Any, list[tuple[str, str]]]:
        """A number of a tuple as a variable."""
        if isinstance(value, View) or (is_known(value) and self.assigned[name] == 1):
            return value, []
        variable = self._declare(f"{name}_{k}", kind_of(value))
        return variable, [(variable.text, as_text(value, variable.kind))]

    def _fill(self, view: View, value: Any) -> None:
        """Write a number, or the elements of another array, into all elements of one."""
        if any(_in_c(length) for length in view.shape) or len(view.shape) > 2:
            raise _Refused(f"{self.kernel.py_func.__name__} fills an array whose shape is not known")
        names = [self._declare(self._new("at"), INT) for _ in view.shape]
        for name, length in zip(names, view.shape, strict=True):
            self.say(f"for ({name.text} = 0; {name.text} < {length}; {name.text} += 1) {{")
            self.depth += 1
        place = self._element(view, names)
        if isinstance(value, np.ndarray):
            value = self.writer.table(value, "values")
        if isinstance(value, View):
            value = self._element(value, names)
        self.say(f"{place.text} = {as_text(value, place.kind)};")
        for _ in names:
            self.depth -= 1
            self.say("}")

    # --- expressions

    def of(self, e: ast.expr, target: ast.expr | None = None) -> Any:
        """The value of an expression: known, or in C."""
        return self.writer.lifted(self._of(e, target))

    def _of(self, e: ast.expr, target: ast.expr | None) -> Any:
        match e:
            case ast.Constant(value):
                return value
            case ast.Name(name):
                return self._lookup(name)
            case ast.Tuple(elements):
                places = target.elts if isinstance(target, ast.Tuple) else [None] * len(elements)
                return tuple(self.of(each, place) for each, place in zip(elements, places, strict=True))
            case ast.Attribute(value, name):
                held = self.of(value)
                return held.shape if isinstance(held, View) and name == "shape" else getattr(held, name)
            case ast.Subscript(array, index):
                return self._indexed(self.of(array), self._index(index), ast.unparse(array))
            case ast.BinOp(left, op, right):
                return self._calculated(op, self.of(left), self.of(right))
            case ast.UnaryOp(op, value):
                return self._unary(op, self.of(value))
            case ast.BoolOp(op, values):
                return self._logical(op, values)
            case ast.Compare(left, ops, rights):
                return self._compared(left, ops, rights)
            case ast.IfExp(test, yes, no):
                asked = self.of(test)
                if not _in_c(asked):
                    return self.of(yes if asked else no)
                one, other = self.of(yes), self.of(no)
                kind = REAL if REAL in (kind_of(one), kind_of(other)) else INT
                return Text(kind, f"({asked.text} ? {as_text(one, kind)} : {as_text(other, kind)})")
            case ast.Call(called, arguments, []):
                hint = target.id if isinstance(target, ast.Name) else "array"
                return self._called(called, arguments, hint)
        raise _Refused(f"{self._where(e)} has {ast.unparse(e)!r}")

    def _lookup(self, name: str) -> Any:
        if name in self.env:
            return self.env[name]
        if self.assigned[name]:
            raise _Refused(f"{self.kernel.py_func.__name__} reads {name} before it has a value")
        function = self.kernel.py_func
        closed = inspect.getclosurevars(function).nonlocals
        for names in (self.writer.numbers, closed, function.__globals__, vars(builtins)):
            if name in names:
                return names[name]
        raise _Refused(f"{function.__name__} reads {name}")

    def _index(self, index: ast.expr) -> Any:
        if isinstance(index, ast.Slice):
            low, high = (None if each is None else self.of(each) for each in (index.lower, index.upper))
            return slice(low, high)
        return tuple(map(self._index, index.elts)) if isinstance(index, ast.Tuple) else self.of(index)

    def _indexed(self, value: Any, index: Any, hint: str) -> Any:
        """An element or a part of an array or a tuple."""
        places = index if isinstance(index, tuple) else (index,)
        known = all(
            is_known(each.start) and is_known(each.stop) if isinstance(each, slice) else is_known(each)
            for each in places
        )
        if not isinstance(value, View) and known:
            return value[index]
        if isinstance(value, np.ndarray) and not value.size and isinstance(index, slice):
            return value
        if isinstance(value, np.ndarray):
            value = self.writer.table(value, re.sub(r"\W+", "_", hint))
        if not isinstance(value, View):
            raise _Refused(f"{self.kernel.py_func.__name__} takes an element of {hint} that is not known")
        offset, shape, steps = value.offset, [], []
        for k, (length, step) in enumerate(zip(value.shape, value.steps, strict=True)):
            at = places[k] if k < len(places) else slice(None, None)
            if isinstance(at, slice):
                low = 0 if at.start is None else self._within(at.start, length)
                high = length if at.stop is None else self._within(at.stop, length)
                shape.append(self._calculated(ast.Sub(), high, low))
                steps.append(step)
            else:
                low = self._within(at, length)
            offset = self._calculated(ast.Add(), offset, self._calculated(ast.Mult(), low, step))
        part = View(value.base, tuple(shape), value.kind, offset, tuple(steps), value.constant)
        return part if shape else Text(value.kind, f"{value.base}[{bare(as_text(offset))}]")

    def _within(self, at: Any, length: Any) -> Any:
        """An index that counts from the begin."""
        return self._calculated(ast.Add(), length, at) if not _in_c(at) and at < 0 else at

    def _element(self, view: View, at: Sequence[Text]) -> Text:
        found = self._indexed(view, tuple(at), "")
        assert isinstance(found, Text)
        return found

    def _pointer(self, view: View) -> str:
        return view.base if is_known(view.offset) and view.offset == 0 else f"{view.base} + {as_text(view.offset)}"

    def _calculated(self, op: ast.operator, left: Any, right: Any) -> Any:
        sign, compute = ARITHMETIC[type(op)]
        if is_known(left) and is_known(right):
            return compute(left, right)
        if isinstance(left, tuple) and isinstance(right, tuple) and sign == "+":
            return (*left, *right)
        whole = kind_of(left) == kind_of(right) == INT and not isinstance(op, (ast.Div, ast.Pow))
        if isinstance(op, ast.Pow) and not _in_c(right) and right == 2:
            sign, right = "*", left
        kind = INT if whole else REAL
        for one, other, signs in ((right, left, "+-*/"), (left, right, "+*")):
            if not _in_c(one) and sign in signs and kind_of(other) == kind and one == (0 if sign in "+-" else 1):
                return other  # it is neutral
        if whole and sign == "*" and 0 in (left, right):
            return 0
        texts = as_text(left, kind), as_text(right, kind)
        return Text(kind, f"POW({', '.join(texts)})" if not sign else f"({texts[0]} {sign} {texts[1]})")

    def _unary(self, op: ast.unaryop, value: Any) -> Any:
        if not _in_c(value):
            return (not value) if isinstance(op, ast.Not) else (-value if isinstance(op, ast.USub) else +value)
        return Text(INT, f"(!{value.text})") if isinstance(op, ast.Not) else Text(value.kind, f"(-{value.text})")

    def _logical(self, op: ast.boolop, values: Sequence[ast.expr]) -> Any:
        decides, parts = isinstance(op, ast.Or), []
        for each in values:
            value = self.of(each)
            if _in_c(value):
                parts.append(value.text)
            elif bool(value) is decides:
                return decides
        if not parts:
            return not decides
        return Text(INT, f"({(' || ' if decides else ' && ').join(parts)})") if len(parts) > 1 else Text(INT, parts[0])

    def _compared(self, left: ast.expr, ops: Sequence[ast.cmpop], rights: Sequence[ast.expr]) -> Any:
        values, parts = [self.of(each) for each in (left, *rights)], []
        for one, op, other in zip(values, ops, values[1:], strict=False):
            sign, compute = COMPARED[type(op)]
            if not _in_c(one) and not _in_c(other):
                if not compute(one, other):
                    return False
                continue
            kind = REAL if REAL in (kind_of(one), kind_of(other)) else INT
            parts.append(f"{as_text(one, kind)} {sign} {as_text(other, kind)}")
        return Text(INT, f"({' && '.join(parts)})") if parts else True

    # --- calls

    def _called(self, called: ast.expr, arguments: Sequence[ast.expr], hint: str) -> Any:
        if isinstance(called, ast.Attribute) and called.attr == "copy":
            held = self.of(called.value)
            return self._array(held.shape, held, hint, INT if getattr(held, "kind", REAL) == INT else REAL)
        function = self.of(called)
        values: list[Any] = []
        for each in arguments:
            values += self.of(each.value) if isinstance(each, ast.Starred) else [self.of(each)]
        if function is np.array and isinstance(values[0], tuple):
            made = self._array((len(values[0]),), None, hint, REAL)
            for k, each in enumerate(values[0]):
                self.say(f"{made.base}[{k}] = {bare(as_text(each, REAL))};")
            return made
        if function in NEW:
            return self._made(function, values, hint)
        if isinstance(function, type) and hasattr(function, "_fields"):
            return function(*values)
        if hasattr(function, "py_func"):
            return self.calling(function, values)
        if function is len:
            return values[0].shape[0] if isinstance(values[0], View) else len(values[0])
        if all(map(is_known, values)):
            return function(*values)
        if function in (min, max):
            return self._extreme(function.__name__, values)
        if function in (float, bool, int):
            kind = REAL if function is float else INT
            value = values[0]
            return value if value.kind == kind else Text(kind, f"(({kind}){value.text})")
        if function in MACROS and len(values) == 1:
            kind = INT if MACROS[function].startswith("is") else REAL
            return Text(kind, f"{MACROS[function]}({bare(as_text(values[0], REAL))})")
        raise _Refused(f"{self.kernel.py_func.__name__} calls {getattr(function, '__name__', function)}")

    def _extreme(self, name: str, values: Sequence[Any]) -> Any:
        found = values[0]
        for each in values[1:]:
            kind = REAL if REAL in (kind_of(found), kind_of(each)) else INT
            found = Text(kind, f"{name}_{kind}({bare(as_text(found, kind))}, {bare(as_text(each, kind))})")
        return found

    def _made(self, function: Any, values: Sequence[Any], hint: str) -> View:
        """A new array."""
        shape = values[0] if isinstance(values[0], tuple) else (values[0],)
        value: Any = None if function is np.empty else (values[1] if function is np.full else 0.0)
        kind = kind_of(value) if function is np.full else REAL
        if function is not np.full and len(values) > 1:
            kind = INT if np.dtype(values[1]).kind in "iub" else REAL
        return self._array(shape, value, hint, kind)

    def _array(self, shape: Sequence[Any], value: Any, hint: str, kind: str) -> View:
        if not all(map(is_known, shape)):
            raise _Refused(f"{self.kernel.py_func.__name__} makes an array whose length is not known")
        name = self._own(hint) if hint not in self.arrays and hint != "array" else self._new(f"{hint}")
        self.arrays[name] = kind, int(np.prod(shape, dtype=int))
        view = View(name, tuple(map(int, shape)), kind)
        if value is not None:
            self._fill(view, value)
        return view

    def calling(self, kernel: Any, values: Sequence[Any]) -> Any:
        """The result of a call of another kernel, which is written."""
        tree = _source(kernel)
        returned = _returned(tree)
        if returned != () and all(map(is_known, values)):
            with np.errstate(all="ignore"):
                return kernel.py_func(*values)
        if returned is None:
            return self._inlined(kernel, tree, values)
        changed = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
        formal, key, actual = [], [], []
        for arg, value in zip(tree.args.args, values, strict=True):
            one = self._split(value, arg.arg in changed)
            formal.append(one[0])
            key.append(one[1])
            actual += one[2]
        if self.writer.traces:
            actual = ["numbers", *actual]
        made = self.writer.function(kernel, formal, tuple(key))
        self.called.add(made.name)
        made.is_first |= not self.name
        if len(returned) < 2:
            return Text(returned[0] if returned else INT, f"{made.name}({', '.join(actual)})")
        results = [self._declare(self._new("result"), kind) for kind in returned]
        self.say(f"{made.name}({', '.join([*actual, *(f'&{each.text}' for each in results)])});")
        return tuple(results)

    def _split(self, value: Any, changed: bool) -> tuple[Any, Any, list[str]]:
        """What a parameter is in the function that is called, what tells it from others, and what is given in C."""
        if type(value) is Traced:
            value = self.writer.lifted(value)
        if isinstance(value, tuple) and not is_known(value):
            parts = [self._split(each, changed=False) for each in value]
            formal = _tuple_of(value, (part[0] for part in parts))
            return formal, (type(value), *(part[1] for part in parts)), [text for part in parts for text in part[2]]
        if isinstance(value, Text) or (isinstance(value, float | np.floating) and value != 0):
            return Text(kind_of(value), ""), kind_of(value), [bare(as_text(value))]
        if isinstance(value, View):
            lengths = [length for length in value.shape if _in_c(length)]
            key = tuple("?" if _in_c(length) else length for length in value.shape)
            texts = [self._pointer(value), *map(as_text, lengths)]
            return value, (View, key, value.strides and value.steps, value.kind, value.constant), texts
        return value, known_key(value), []

    def _inlined(self, kernel: Any, tree: ast.FunctionDef, values: Sequence[Any]) -> Any:
        """The value of a function that is one expression and returns arrays."""
        last = tree.body[-1]
        if not isinstance(last, ast.Return) or last.value is None or len(tree.body) > 2:
            raise _Refused(f"{kernel.py_func.__name__} returns arrays")
        mine, self.env = self.env, dict(zip((arg.arg for arg in tree.args.args), values, strict=True))
        own, self.kernel = self.kernel, kernel
        try:
            return self.of(last.value)
        finally:
            self.env, self.kernel = mine, own


def _loaded(target: ast.expr) -> ast.expr:
    """The same expression, to be read."""
    found: ast.expr = ast.parse(ast.unparse(target), mode="eval").body
    return found


def _returned(tree: ast.FunctionDef) -> tuple[str, ...] | None:
    """The kinds of the numbers that a function returns; None where it returns something else."""
    text = "float" if tree.returns is None else ast.unparse(tree.returns)
    parts = text.removeprefix("tuple[").removesuffix("]").split(", ") if text.startswith("tuple[") else [text]
    if not all(part in DECLARED for part in parts):
        return None
    return tuple(kind for part in parts for kind in DECLARED[part])
