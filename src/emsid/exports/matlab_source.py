"""The C of a model as MATLAB: the functions and statements of a form in C, one by one.

The forms are a small part of C: functions of numbers and arrays, loops, conditions, assignments. A pointer in C is an
argument and a result in MATLAB, so that ``f(x, rows + 2)`` becomes ``[rows(3:end)] = f(x, rows(3:end))``; indices begin
at one. A conditional expression is a statement of its own before that which uses it, as MATLAB has none. A motor with a
shaft, whose steps have sizes of their own, is left to C and FMU: its powers are refused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from emsid.errors import ModelError

NAMES = {
    **{name.upper(): name for name in ("exp", "expm1", "log1p", "sin", "cos", "tanh", "sqrt", "log", "ceil", "floor")},
    "FABS": "abs",
    "ATAN": "atan",
    "ATANH": "atanh",
    "sign_of": "sign",
    **{f"{bound}_{kind}": bound for bound in ("min", "max") for kind in ("real", "int")},
    "K_INFINITY": "Inf",
    "K_NAN": "NaN",
    "K": "",
    "isnan": "isnan",
    "isfinite": "isfinite",
}
"""Macros and functions of C, as MATLAB calls them; their definitions are left out."""
TOKEN = re.compile(r"\s*(?:(\d+\.?\d*(?:[eE][-+]?\d+)?)|([A-Za-z_]\w*)|(->|\+\+|[-+]=|[|&=!<>]=|&&|\|\||.))")
BINARY = (("||",), ("&&",), ("==", "!="), ("<", "<=", ">", ">="), ("+", "-"), ("*", "/", "%"))
"""Operators of two operands, those that bind least first."""
RESERVED = re.compile(r"\b(end|function|otherwise|try|catch|global|persistent|until)\b")
"""Words of MATLAB or Octave that are names in C."""
LOOP = re.compile(
    r"for \((?P<name>\w+) = (?P<first>.*?); \w+ (?P<sign><|>=|>|\+ 1 <) (?P<limit>.*?); "
    r"(?:\+\+\w+|\w+ (?P<by>[-+]= .*))\) \{"
)
FUNCTION = re.compile(r"^static (real|int|void) (\w+)\(([^)]*)\)\n\{\n(.*?)^\}\n", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Function:
    """A function of C.

    Attributes:
        name: of it.
        value: whether it returns one, ``int`` or ``real``, or empty.
        arguments: name and kind of every argument: ``int``, ``real``, ``array`` that is read, ``changed`` array, or a
            ``result``.
        body: its statements.
    """

    name: str
    value: str
    arguments: tuple[tuple[str, str], ...]
    body: str

    @classmethod
    def of(cls, value: str, name: str, arguments: str, body: str) -> Function:
        """That of the parts of its text."""
        known = []
        for text in filter(None, map(str.strip, arguments.split(","))):
            kind, word = text.replace("*", "* ").split()[-2:] if "*" not in text else ("*", text.split("*")[-1].strip())
            if kind == "*":
                kind = "array" if text.startswith("const") else "result" if word.startswith("result_") else "changed"
            known.append((word, kind))
        return cls(name, "" if value == "void" else value, tuple(known), body)

    @property
    def outputs(self) -> list[str]:
        """The arguments that are results in MATLAB."""
        return [name for name, kind in self.arguments if kind in ("changed", "result")]


@dataclass
class Translator:
    """Functions of C, and what is known of their names.

    Attributes:
        functions: by name.
        numbers: macros of whole numbers.
    """

    functions: Mapping[str, Function]
    numbers: Mapping[str, str]
    _whole: set[str] = field(default_factory=set)
    _before: list[str] = field(default_factory=list)
    _tokens: list[str] = field(default_factory=list)
    _text: str = ""
    _made: int = 0

    def lines(self, body: str, whole: set[str]) -> list[str]:
        """Statements as lines of MATLAB; the value of a function is called ``value``.

        Args:
            body: the statements.
            whole: names of whole numbers.

        Raises:
            ModelError: for a statement that MATLAB does not have here.
        """
        self._whole, found = set(whole), []
        for line in body.splitlines():
            text, indent = line.strip().removesuffix(";"), line[: len(line) - len(line.lstrip())][2:]
            if not text or text.startswith(("(void)", "/*", "*/")):
                continue
            self._before = []
            if text == "}":
                made = ["end"]
            elif text == "} else {":
                made = ["else"]
            elif text == "for (;;) {":
                made = ["while true"]
            elif loop := LOOP.fullmatch(text):
                name, first, sign, limit, by = loop["name"], loop["first"], loop["sign"], loop["limit"], loop["by"]
                self._whole.add(name)
                last = {"<": "{} - 1", ">=": "{}", ">": "{} + 1", "+ 1 <": "{} - 2"}[sign].format(
                    self._expression(limit)
                )
                step = "1" if by is None else self._expression(by.replace("+= ", "").replace("-= ", "-"))
                made = [f"for {name} = {self._expression(first)}:{step}:{last}"]
            elif opened := re.fullmatch(r"(if|while) \((.*)\) \{", text):
                made = [f"{opened[1]} {self._expression(opened[2])}"]
                if opened[1] == "while" and self._before:
                    raise ModelError(f"the loop {text!r} has no form in MATLAB")
            else:
                made = [f"{each};" for each in self._statement(text) if each]
            found += [indent + each for each in (*self._before, *made)]
        return found

    def _statement(self, text: str) -> list[str]:
        """A statement without a block."""
        if text in ("break", "continue", "return"):
            return [text]
        if text.startswith("return "):
            return [*self._assigned("value", text.removeprefix("return ")), "return"]
        declared = re.fullmatch(r"(?:static )?(?:const )?(real|int) (\w+)(?:\[(.+)\])?(?: = (.*))?", text)
        if declared:
            kind, name, size, value = declared.groups()
            if kind == "int":
                self._whole.add(name)
            if size is not None:
                return [f"{name} = zeros(1, {self._expression(size)})"]
            return self._assigned(name, value) if value is not None else [f"{name} = 0"]
        parts = re.fullmatch(r"\*?([^=]*?[^=!<>+\- ]) ([-+]?)= (.*)", text)
        if parts:
            target = self._expression(parts[1])
            return self._assigned(target, f"{parts[1]} {parts[2]} ({parts[3]})" if parts[2] else parts[3])
        return self._assigned("", text)

    def _assigned(self, target: str, text: str) -> list[str]:
        """What assigns an expression, or a call that has results of its own."""
        call = re.fullmatch(r"(\w+)\((.*)\)", text)
        called = self.functions.get(call[1]) if call else None
        if called is None or not (called.outputs or not target):
            return [f"{target} = {self._expression(text)}"]
        assert call is not None
        given, results, after = [], [target] * bool(target), []
        for argument, (_, kind) in zip(_split(call[2]), called.arguments, strict=True):
            made = self._pointer(argument) if kind in ("array", "changed") else self._expression(argument.lstrip("&"))
            if kind != "result":
                given.append(made)
            if kind == "changed":  # assigned by position: another argument may be a part of the same array
                self._made += 1
                results.append(f"made_{self._made}")
                at = re.search(r"\((\d+)", made)
                after.append((int(at[1]) if at else 0, f"{made} = made_{self._made}"))
            elif kind == "result":
                results.append(made)
        return [f"[{', '.join(results)}] = {called.name}({', '.join(given)})", *(each for _, each in sorted(after))]

    def _pointer(self, text: str) -> str:
        """An array, or the part of it behind a pointer."""
        base, plus, offset = text.partition(" + ")
        array = self._expression(base)
        at = self._expression(offset) if plus else "0"
        if at == "0":
            return array
        return f"{array}({int(at) + 1}:end)" if at.isdigit() else f"{array}({at} + 1:end)"

    # --- expressions -------------------------------------------------------------------------------------------------

    def _expression(self, text: str) -> str:
        """An expression of C."""
        self._tokens = [next(filter(None, each.groups())) for each in TOKEN.finditer(text.strip())]
        self._text = text
        made, _ = self._conditional()
        if self._tokens:
            raise ModelError(f"the expression {text!r} has no form in MATLAB")
        return made

    def _next(self, *expected: str) -> str:
        if not self._tokens or (expected and self._tokens[0] not in expected):
            raise ModelError(f"the expression {self._text!r} has no form in MATLAB")
        return self._tokens.pop(0)

    def _conditional(self) -> tuple[str, bool]:
        condition, whole = self._binary(0)
        if self._tokens[:1] != ["?"]:
            return condition, whole
        self._next("?")
        self._made += 1
        name, outside = f"chosen_{self._made}", self._before
        self._before = []
        yes, first = self._conditional()
        inside_yes, self._before = self._before, []
        self._next(":")
        no, second = self._conditional()
        inside_no, self._before = self._before, outside
        self._before += [f"if {condition}", *inside_yes, f"  {name} = {yes};", "else", *inside_no, f"  {name} = {no};"]
        self._before.append("end")
        return name, first and second

    def _binary(self, level: int) -> tuple[str, bool]:
        if level == len(BINARY):
            return self._unary()
        left, whole = self._binary(level + 1)
        while self._tokens and self._tokens[0] in BINARY[level]:
            sign = self._next()
            right, also = self._binary(level + 1)
            whole = (whole and also) or level < BINARY.index(("+", "-"))
            if sign == "%" or (sign == "/" and whole):
                left = f"mod({left}, {right})" if sign == "%" else f"floor(({left}) / ({right}))"
            else:
                left = f"{left} {'~=' if sign == '!=' else sign} {right}"
        return left, whole

    def _unary(self) -> tuple[str, bool]:
        token = self._next()
        if token in ("-", "!", "*"):
            made, whole = self._unary()
            return {"-": f"-{made}", "!": f"~({made})", "*": made}[token], whole
        if token == "(" and self._tokens[:2] in (["real", ")"], ["int", ")"]):
            kind = self._next()
            self._next(")")
            made, whole = self._unary()
            return (made, False) if kind == "real" else (made if whole else f"fix({made})", True)
        if token == "(":
            made, whole = self._conditional()
            self._next(")")
            return f"({made})", whole
        if token[0].isdigit():
            return token, token.isdigit()
        return self._named(token)

    def _named(self, name: str) -> tuple[str, bool]:
        """A name with what follows it: a call, a member, an index."""
        if self._tokens[:1] == ["("]:
            self._next("(")
            arguments: list[str] = []
            while self._tokens[:1] != [")"]:
                arguments.append(self._conditional()[0])
                if self._tokens[:1] != [")"]:
                    self._next(",")
            self._next(")")
            known = self.functions.get(name)
            if (known is None and name not in NAMES) or (known is not None and known.outputs):
                raise ModelError(f"the call of {name} in {self._text!r} has no form in MATLAB")
            called = NAMES.get(name, name)
            whole = known.value == "int" if known is not None else name.endswith("_int")
            return (f"{called}({', '.join(arguments)})" if called else arguments[0]), whole
        made, whole = NAMES.get(name, self.numbers.get(name, name)), name in self._whole or name in self.numbers
        while self._tokens[:1] in (["->"], ["["]):
            if self._next() == "->":
                made = f"{made}.{self._next()}"
                continue
            index, _ = self._conditional()
            self._next("]")
            made = f"{made}({int(index) + 1})" if index.isdigit() else f"{made}({index} + 1)"
        return made, whole


def _without_unchanged(functions: dict[str, Function]) -> dict[str, Function]:
    """The functions, whose arrays are results only where they or what they call assigns an element."""
    changed = {
        (name, word)
        for name, each in functions.items()
        for word, kind in each.arguments
        if kind == "changed" and re.search(rf"\b{word}\[[^=;]*\] [-+]?= ", each.body)
    }
    calls = [
        (name, word, called, other)
        for name, each in functions.items()
        for call in re.finditer(r"(\w+)\((.*)\);$", each.body, re.MULTILINE)
        if (called := call[1]) in functions
        for argument, (other, _) in zip(_split(call[2]), functions[called].arguments, strict=False)
        for word in re.findall(r"^\w+", argument)
    ]
    while new := {(name, word) for name, word, called, other in calls if (called, other) in changed} - changed:
        changed |= new
    return {
        name: replace(
            each,
            arguments=tuple(
                (word, "array" if kind == "changed" and (name, word) not in changed else kind)
                for word, kind in each.arguments
            ),
        )
        for name, each in functions.items()
    }


def _split(arguments: str) -> list[str]:
    """The arguments of a call, by the commas outside of brackets."""
    parts, depth = [""], 0
    for sign in arguments:
        depth += (sign in "([") - (sign in ")]")
        if sign == "," and not depth:
            parts.append("")
        else:
            parts[-1] += sign
    return [part.strip() for part in parts if part.strip()]


def translated(functions: str, step: str, tables: Mapping[str, str], whole: set[str], head: str) -> str:
    """The functions of a form in C and its step as a file of MATLAB.

    Args:
        functions: of the form.
        step: its statements, of ``s``, ``u`` and ``y``.
        tables: the constants in MATLAB, by name.
        whole: those of whole numbers.
        head: the first lines of the function of the step.

    Raises:
        ModelError: for a statement that has no form in MATLAB.
    """
    functions, step = (RESERVED.sub(r"\1_", text) for text in (functions, step))
    known = {each[2]: Function.of(*each.groups()) for each in FUNCTION.finditer(functions) if each[2] not in NAMES}
    known = _without_unchanged(known)
    numbers = dict(re.findall(r"^#define (\w+) (\d+)$", functions, re.MULTILINE))
    translator = Translator(known, numbers)

    def used(lines: list[str]) -> list[str]:
        text = "\n".join(lines)
        return [f"  {name} = {row};" for name, row in tables.items() if re.search(rf"\b{name}\b", text)]

    body, texts = translator.lines(step, whole), dict[str, str]()
    for name, each in known.items():
        results = ["value"] * bool(each.value) + each.outputs
        given = [argument for argument, kind in each.arguments if kind != "result"]
        inside = translator.lines(each.body, whole | {word for word, kind in each.arguments if kind == "int"})
        first = f"function [{', '.join(results)}] = {name}({', '.join(given)})"
        texts[name] = "\n".join([first, *used(inside), *inside, "end", ""])
    waiting, done = ["\n".join(body)], set[str]()
    while waiting:
        text = waiting.pop()
        new = {name for name in known if name not in done and re.search(rf"\b{name}\(", text)}
        done |= new
        waiting += [texts[name] for name in new]
    parts = [texts[name] for name in known if name in done]
    return "\n".join([head, *used(body), *body, "end", "", *parts])
