"""Prints the statements of a law in a language: what differs is a handful of words, kept in `Language`."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from autotune.core.errors import ConfigurationError
from autotune.export.law import Law

_OPERATORS: dict[type, tuple[str, int]] = {
    ast.Add: ("+", 1),
    ast.Sub: ("-", 1),
    ast.Mult: ("*", 2),
    ast.Div: ("/", 2),
}
_COMPARISONS: dict[type, str] = {ast.GtE: ">=", ast.LtE: "<=", ast.Gt: ">", ast.Lt: "<"}
_UNARY = 3


@dataclass(frozen=True, slots=True)
class Language:
    """Words of a target language.

    Attributes:
        assign: between a name and its value.
        functions: names of the functions of a law.
        number: prints a literal.
        name: prints a variable, a state or a constant.
        branch: opens a branch, given its condition; `otherwise` and `end` as they are.
    """

    assign: str
    functions: Mapping[str, str]
    number: Callable[[float], str]
    name: Callable[[str], str]
    branch: Callable[[str], str]
    otherwise: str
    end: str


def printed(statements: str, language: Language, indent: int = 0) -> list[str]:
    """Lines of the statements in a language, indented by four spaces a level."""
    return [line for statement in ast.parse(statements).body for line in _lines(statement, language, indent)]


def assigned(law: Law) -> list[str]:
    """Names of the variables that a law's statements give values, in their order, states left out."""
    states = {state.name for state in law.states}
    found: dict[str, None] = {}
    for block in law.blocks:
        for node in ast.walk(ast.parse(block.statements)):
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                found[node.targets[0].id] = None
    return [name for name in found if name not in states]


def called(law: Law) -> set[str]:
    """Names of the functions that a law calls."""
    return {
        node.func.id
        for block in law.blocks
        for node in ast.walk(ast.parse(block.statements))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }


def _lines(statement: ast.stmt, language: Language, indent: int) -> Iterator[str]:
    margin = " " * 4 * indent
    if isinstance(statement, ast.Assign):
        target = _expression(statement.targets[0], language)
        yield f"{margin}{target} {language.assign} {_expression(statement.value, language)};"
    elif isinstance(statement, ast.If):
        yield margin + language.branch(_expression(statement.test, language))
        for inner in statement.body:
            yield from _lines(inner, language, indent + 1)
        if statement.orelse:
            yield margin + language.otherwise
            for inner in statement.orelse:
                yield from _lines(inner, language, indent + 1)
        yield margin + language.end
    else:
        raise _unknown(statement)


def _expression(node: ast.expr, language: Language, binding: int = 0) -> str:
    """Text of an expression; in brackets where it binds less than `binding`."""
    match node:
        case ast.Constant(value=value) if isinstance(value, (int, float)):
            return language.number(float(value))
        case ast.Name(id=name):
            return language.name(name)
        case ast.Call(func=ast.Name(id=name), args=arguments):
            inside = ", ".join(_expression(argument, language) for argument in arguments)
            return f"{language.functions[name]}({inside})"
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return _bracketed(f"-{_expression(operand, language, _UNARY)}", _UNARY, binding)
        case ast.BinOp(left=left, op=operator, right=right):
            sign, own = _OPERATORS[type(operator)]
            # the right operand needs to bind more: a - (b - c) is not a - b - c
            text = f"{_expression(left, language, own)} {sign} {_expression(right, language, own + 1)}"
            return _bracketed(text, own, binding)
        case ast.Compare(left=left, ops=[comparison], comparators=[right]):
            sign = _COMPARISONS[type(comparison)]
            return f"{_expression(left, language)} {sign} {_expression(right, language)}"
    raise _unknown(node)


def _bracketed(text: str, own: int, binding: int) -> str:
    return f"({text})" if own < binding else text


def _unknown(node: ast.AST) -> ConfigurationError:
    return ConfigurationError(f"{ast.dump(node)[:80]} cannot be printed in another language")
