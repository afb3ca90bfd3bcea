"""Writes compiled kernels of effects down as statements: the law is printed from the physics itself.

A kernel is a small Python function of parameters, states and the motion. With the parameters of one model known, its
loops are unrolled, its branches on parameters decided, and what is left is assignments. An effect that is added to
the program is exported without another line.
"""

from __future__ import annotations

import ast
import inspect
import operator
import textwrap
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from autotune.core.errors import ConfigurationError

MATHEMATICS = ("exp", "sin", "cos", "pow", "abs", "min", "max")
"""Functions that statements may call."""
_NUMBERS: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_TESTS: dict[type, Callable[[float, float], bool]] = {
    ast.Gt: operator.gt, ast.GtE: operator.ge, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Term:
    """An expression, and its value where that does not depend on the motion."""

    node: ast.expr
    value: float | None = None


def named(name: str, value: float | None = None) -> Term:
    """A variable, state or constant."""
    return Term(ast.Name(name, ast.Load()), value)


class _Break(Exception):
    pass


class _Return(Exception):
    def __init__(self, term: Term) -> None:
        super().__init__()
        self.term = term


class Writer:
    """Writes one call of a kernel down.

    Args:
        parameter: the constant that stands for a place in the vector of parameters.
        state: the name that stands for a place in the vector of states.
    """

    def __init__(self, parameter: Callable[[int], Term], state: Callable[[int], str]) -> None:
        self._parameter, self._state = parameter, state
        self._lines: list[ast.stmt] = []
        self._variables: dict[str, Term] = {}
        self._globals: Mapping[str, Any] = {}
        self._prefix, self._branches, self._fresh = "", 0, 0

    def call(self, kernel: Callable[..., Any], *arguments: Term | None) -> tuple[str, str]:
        """Statements, and the expression of what the kernel returns; None stands for parameters and states.

        Raises:
            ConfigurationError: the kernel has what statements cannot say.
        """
        function = inspect.unwrap(getattr(kernel, "py_func", kernel))
        tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
        if not isinstance(tree, ast.FunctionDef):
            raise _unknown(tree)
        self._globals, self._prefix = function.__globals__, f"{function.__name__}_"
        names = [argument.arg for argument in tree.args.args]
        self._variables = {n: a for n, a in zip(names, arguments, strict=True) if a is not None}
        try:
            self._run(tree.body)
        except _Return as ended:
            body = ast.Module(self._lines, [])
            return ast.unparse(ast.fix_missing_locations(body)), ast.unparse(ended.term.node)
        raise _unknown(tree)

    def _run(self, body: list[ast.stmt]) -> None:
        for statement in body:
            self._statement(statement)

    def _statement(self, statement: ast.stmt) -> None:
        match statement:
            case ast.Expr(value=ast.Constant()):
                return
            case ast.Return(value=ast.expr() as value) if not self._branches:
                raise _Return(self._term(value))
            case ast.Assign(targets=[target], value=value):
                self._assign(target, self._term(value))
            case ast.AnnAssign(target=target, value=ast.expr() as value):
                self._assign(target, self._term(value))
            case ast.AugAssign(target=target, op=sign, value=value):
                self._assign(target, self._binary(self._term(_loaded(target)), sign, self._term(value)))
            case ast.For(target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range")) as over):
                self._loop(name, [self._known(argument) for argument in over.args], statement.body)
            case ast.Break() if not self._branches:
                raise _Break
            case ast.If(test=test, body=then, orelse=otherwise):
                self._choice(self._term(test), then, otherwise)
            case _:
                raise _unknown(statement)

    def _loop(self, name: str, bounds: list[float], body: list[ast.stmt]) -> None:
        for number in range(*(int(bound) for bound in bounds)):
            self._variables[name] = Term(ast.Constant(number), number)
            try:
                self._run(body)
            except _Break:
                return

    def _choice(self, test: Term, then: list[ast.stmt], otherwise: list[ast.stmt]) -> None:
        if test.value is not None:
            self._run(then if test.value else otherwise)
            return
        for name in sorted({name for branch in (then, otherwise) for name in _given(branch)}):
            if name in self._variables:  # its value before, where a branch leaves it alone
                self._store(name, self._variables[name])
        with self._aside() as first:
            self._run(then)
        with self._aside() as second:
            self._run(otherwise)
        self._lines.append(ast.If(test.node, first, second))

    @contextmanager
    def _aside(self) -> Iterator[list[ast.stmt]]:
        """Collects the statements of a branch."""
        whole, self._lines = self._lines, []
        self._branches += 1
        try:
            yield self._lines
        finally:
            self._branches -= 1
            self._lines = whole

    def _assign(self, target: ast.expr, term: Term) -> None:
        if isinstance(target, ast.Name) and term.value is not None and not self._branches:
            self._variables[target.id] = term
        elif isinstance(target, ast.Name):
            self._store(target.id, term)
        else:
            self._lines.append(ast.Assign([self._term(_loaded(target)).node], term.node))

    def _store(self, name: str, term: Term) -> None:
        own = named(f"{self._prefix}{name}")
        if ast.unparse(own.node) != ast.unparse(term.node):
            self._lines.append(ast.Assign([own.node], term.node))
        self._variables[name] = own

    def _term(self, node: ast.expr) -> Term:
        match node:
            case ast.Constant(value=int() | float() as value):
                return Term(ast.Constant(float(value)), float(value))
            case ast.Name(id=name):
                return self._name(name)
            case ast.Subscript(value=ast.Name(id="p"), slice=at):
                return self._parameter(int(self._known(at)))
            case ast.Subscript(value=ast.Name(id="state"), slice=at):
                return named(self._state(int(self._known(at))))
            case ast.BinOp(left=left, op=sign, right=right):
                return self._binary(self._term(left), sign, self._term(right))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                inner = self._term(operand)
                negative = None if inner.value is None else -inner.value
                return Term(ast.UnaryOp(ast.USub(), inner.node), negative)
            case ast.Compare(left=left, ops=[test], comparators=[right]):
                return _compared(self._term(left), test, self._term(right))
            case ast.IfExp(test=test, body=then, orelse=otherwise):
                return self._either(self._term(test), then, otherwise)
            case ast.Call(func=ast.Name(id="where"), args=[test, then, otherwise]):
                return self._either(self._term(test), then, otherwise)
            case ast.Call(func=ast.Name(id="anywhere"), args=[test]):
                return self._term(test)
            case ast.UnaryOp(op=ast.Not(), operand=test):
                return _negated(self._term(test))
            case ast.Call(func=function, args=arguments):
                return self._called(function, [self._term(argument) for argument in arguments])
        raise _unknown(node)

    def _name(self, name: str) -> Term:
        if name in self._variables:
            return self._variables[name]
        value = self._globals.get(name)
        if isinstance(value, (int, float)):
            return Term(ast.Constant(float(value)), float(value))
        raise _unknown(ast.Name(name, ast.Load()))

    def _known(self, node: ast.expr) -> float:
        value = self._term(node).value
        if value is None:
            raise _unknown(node)
        return value

    def _binary(self, left: Term, sign: ast.operator, right: Term) -> Term:
        if type(sign) not in _NUMBERS:
            raise _unknown(ast.BinOp(left.node, sign, right.node))
        value = None
        if left.value is not None and right.value is not None:
            value = _NUMBERS[type(sign)](left.value, right.value)
        if isinstance(sign, ast.Add) and isinstance(left.node, ast.Constant) and left.value == 0.0:
            return right
        if isinstance(sign, ast.Pow):
            return Term(_function("pow", [left, right]), value)
        return Term(ast.BinOp(left.node, sign, right.node), value)

    def _either(self, test: Term, then: ast.expr, otherwise: ast.expr) -> Term:
        if test.value is not None:
            return self._term(then if test.value else otherwise)
        self._fresh += 1
        name = f"choice_{self._fresh}"
        with self._aside() as first:
            self._store(name, self._term(then))
        with self._aside() as second:
            self._store(name, self._term(otherwise))
        self._lines.append(ast.If(test.node, first, second))
        return self._variables[name]

    def _called(self, function: ast.expr, arguments: list[Term]) -> Term:
        if isinstance(function, ast.Attribute) and ast.unparse(function.value) == "math":
            name = {"fabs": "abs"}.get(function.attr, function.attr)
        else:
            name = ast.unparse(function)
        if name == "float":
            return arguments[0]
        if name not in MATHEMATICS:
            raise _unknown(function)
        return Term(_function(name, arguments))


def _negated(test: Term) -> Term:
    return Term(ast.UnaryOp(ast.Not(), test.node), None if test.value is None else float(not test.value))


def _function(name: str, arguments: list[Term]) -> ast.expr:
    return ast.Call(ast.Name(name, ast.Load()), [argument.node for argument in arguments], [])


def _compared(left: Term, test: ast.cmpop, right: Term) -> Term:
    if type(test) not in _TESTS:
        raise _unknown(left.node)
    value = None
    if left.value is not None and right.value is not None:
        value = float(_TESTS[type(test)](left.value, right.value))
    return Term(ast.Compare(left.node, [test], [right.node]), value)


def _given(body: list[ast.stmt]) -> Iterator[str]:
    """Names that statements give values."""
    for node in (node for statement in body for node in ast.walk(statement)):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


def _loaded(target: ast.expr) -> ast.expr:
    return ast.parse(ast.unparse(target), mode="eval").body


def _unknown(node: ast.AST) -> ConfigurationError:
    return ConfigurationError(
        f"this law cannot be written for another controller: its kernel has {ast.unparse(node)[:80]!r}; "
        "take that effect out of the model"
    )
