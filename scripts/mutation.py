"""Small faults for a source file: what `mutants.py` puts into it, one at a time.

Each kind is a slip of a person who writes or changes code, and each was once found
unnoticed by hand: another operator or number, two arguments in the wrong order, a call
left out, the other channel, a comparison that ends too early, a line one too late.
Docstrings, messages and what raises them stay as they are.
"""

import ast
import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitOr: ast.BitAnd,
    ast.BitAnd: ast.BitOr,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
"""Operators, and what stands in the place of each."""

TWINS = (
    ("min", "max"),
    ("any", "all"),
    ("CONTACT", "AIR"),
    ("contact", "air"),
    ("local", "remote"),
    ("inbound", "outbound"),
    ("caller", "answerer"),
    ("robot", "operator"),
    ("first", "last"),
    ("highest", "lowest"),
    ("inputs", "outputs"),
    ("before", "following"),
    ("start", "end"),
)
"""Words in whose place the other may have been meant. A name is changed only into one
that the same file has."""

NOT_CODE = {"annotation", "returns", "decorator_list", "type_params"}

TEXTS = (ast.Compare, ast.MatchValue, ast.Dict, ast.List, ast.Tuple)
"""A string in one of these is no message."""

SHORTENED = 8
"""Characters of a secret that a shortened comparison still compares."""


@dataclass(frozen=True, eq=False)
class Change:
    """A fault at one place of a tree.

    - ``kind``: one of `KINDS`.
    - ``owner``, ``field``, ``value``: the attribute of a node that changes, and what it
      becomes.
    """

    kind: str
    line: int
    old: str
    new: str
    owner: ast.AST
    field: str
    value: Any

    def __str__(self) -> str:
        return f"{self.line} [{self.kind}] {self.old} -> {self.new}"

    def made_in(self, tree: ast.Module) -> ast.Module:
        """Return a copy of the tree with this fault."""
        before = getattr(self.owner, self.field)
        setattr(self.owner, self.field, self.value)
        try:
            return copy.deepcopy(tree)
        finally:
            setattr(self.owner, self.field, before)


def changes(tree: ast.Module) -> Iterator[Change]:
    """Yield every fault that there is for a file."""
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    names |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    names |= {"min", "max", "any", "all"}
    for owner, field, index, node in _places(tree):
        for kind, variants in KINDS.items():
            for new in variants(node, owner, field, names):
                line = getattr(node, "lineno", getattr(owner, "lineno", 0))
                old = ast.unparse(node)
                siblings = getattr(owner, field)
                value = (
                    [*siblings[:index], new, *siblings[index + 1 :]]
                    if index >= 0
                    else new
                )
                yield Change(kind, line, old, ast.unparse(new), owner, field, value)
    yield from _moved_lines(tree)


def _places(node: ast.AST) -> Iterator[tuple[ast.AST, str, int, ast.AST]]:
    """Yield the owner, field, index (-1: the field itself) and node of everything under
    ``node`` that is code."""
    for field, value in ast.iter_fields(node):
        if field in NOT_CODE:
            continue
        for index, child in (
            enumerate(value) if isinstance(value, list) else [(-1, value)]
        ):
            if isinstance(child, ast.AST) and not _is_text(child):
                yield node, field, index, child
                yield from _places(child)


def _is_text(node: ast.AST) -> bool:
    """Whether a node is a docstring, a formatted message, what raises one, or a
    type."""
    match node:
        case ast.JoinedStr() | ast.Raise() | ast.Expr(value=ast.Constant()):
            return True
        case ast.Subscript(value=ast.Name(id="Literal")):
            return True
    return False


def _other_operators(
    node: ast.AST, owner: ast.AST, field: str, _: set[str]
) -> Iterator[ast.AST]:
    """Another operator, the opposite condition, another number or compared string."""
    match node:
        case ast.Compare(ops=ops):
            for place, op in enumerate(ops):
                changed = copy.deepcopy(node)
                changed.ops[place] = SWAPS[type(op)]()  # type: ignore[call-overload]
                yield changed
        case ast.BinOp(op=op) | ast.AugAssign(op=op) | ast.BoolOp(op=op) if (
            type(op) in SWAPS
        ):
            changed = copy.deepcopy(node)
            changed.op = SWAPS[type(op)]()  # type: ignore[assignment]
            yield changed
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            yield node.operand
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int(value) | float(value)):
            yield ast.Constant(
                value + 1 if isinstance(value, int) or not value else 2 * value
            )
        case ast.Constant(value=str(value)) if isinstance(owner, TEXTS):
            yield ast.Constant(value + "x")
    if field == "test" and not isinstance(node, ast.Compare | ast.UnaryOp):
        yield ast.UnaryOp(ast.Not(), node)  # type: ignore[arg-type]


def _swapped_arguments(
    node: ast.AST, _: ast.AST, field: str, names: set[str]
) -> Iterator[ast.AST]:
    """Two neighbouring arguments of a call in the wrong order."""
    if not isinstance(node, ast.Call):
        return
    for place, (first, second) in enumerate(pairwise(node.args)):
        starred = isinstance(first, ast.Starred) or isinstance(second, ast.Starred)
        if starred or ast.dump(first) == ast.dump(second):
            continue
        changed = copy.deepcopy(node)
        changed.args[place : place + 2] = [second, first]
        yield changed
    for place, (one, other) in enumerate(pairwise(node.keywords)):
        # Two numbers with names of their own are seldom mistaken for each other.
        if one.arg and other.arg and isinstance(one.value, ast.Name | ast.Attribute):
            changed = copy.deepcopy(node)
            changed.keywords[place].value = other.value
            changed.keywords[place + 1].value = one.value
            yield changed


def _dropped_statements(
    node: ast.AST, owner: ast.AST, field: str, _: set[str]
) -> Iterator[ast.AST]:
    """A call, or a change of state, left out."""
    match node:
        case ast.Expr(value=ast.Call() | ast.Await()):
            yield ast.Pass()
        case (
            ast.Assign(targets=[ast.Attribute()])
            | ast.AugAssign(target=ast.Attribute())
        ):
            # What __init__ leaves out fails at once.
            if not (isinstance(owner, ast.FunctionDef) and owner.name == "__init__"):
                yield ast.Pass()


def _other_names(
    node: ast.AST, _: ast.AST, field: str, names: set[str]
) -> Iterator[ast.AST]:
    """The other of two channels, ends or directions."""
    match node:
        case ast.Name(id=name):
            for twin in _twins(name, names):
                yield ast.Name(twin, node.ctx)
        case ast.Attribute(attr=name):
            for twin in _twins(name, names):
                yield ast.Attribute(node.value, twin, node.ctx)
        case ast.Slice(lower=None, upper=ast.expr() as bound, step=None):
            yield ast.Slice(bound, None, None)
        case ast.Slice(lower=ast.expr() as bound, upper=None, step=None):
            yield ast.Slice(None, bound, None)


def _twins(name: str, names: set[str]) -> Iterator[str]:
    words = name.split("_")
    for one, other in (*TWINS, *(pair[::-1] for pair in TWINS)):
        twin = "_".join(other if word == one else word for word in words)
        if twin != name and twin in names:
            yield twin


def _shortened_comparisons(
    node: ast.AST, _: ast.AST, field: str, names: set[str]
) -> Iterator[ast.AST]:
    """A condition without one of its parts; a secret compared by its beginning."""
    match node:
        case ast.BoolOp(op=op, values=values):
            for place in range(len(values)):
                rest = [*values[:place], *values[place + 1 :]]
                yield rest[0] if len(rest) == 1 else ast.BoolOp(op, rest)
        case ast.Compare(left=left, ops=[op, _, *_], comparators=comparators):
            yield ast.Compare(left, [op], comparators[:1])
            yield ast.Compare(comparators[0], node.ops[1:], comparators[1:])
        case ast.Call(func=ast.Attribute(attr="compare_digest"), args=[one, other]):
            yield ast.Call(node.func, [_beginning(one), _beginning(other)], [])


def _beginning(text: ast.expr) -> ast.Subscript:
    return ast.Subscript(
        text, ast.Slice(None, ast.Constant(SHORTENED), None), ast.Load()
    )


Variants = Callable[[ast.AST, ast.AST, str, set[str]], Iterator[ast.AST]]
"""Yields what may stand in a node's place, from the node, its owner, the field of it,
and all names of the file."""

KINDS: dict[str, Variants] = {
    "operator": _other_operators,
    "argument": _swapped_arguments,
    "call": _dropped_statements,
    "name": _other_names,
    "comparison": _shortened_comparisons,
}
"""All but ``line``, which changes a block of statements rather than one node."""

ALL_KINDS = (*KINDS, "line")


def _moved_lines(tree: ast.Module) -> Iterator[Change]:
    """A statement that comes one too late."""
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if function.name == "__init__":
            continue  # attributes come into being in any order
        for owner in _within(function):
            for field in ("body", "orelse", "finalbody"):
                block = getattr(owner, field, None)
                if not isinstance(block, list):
                    continue
                for place, (one, other) in enumerate(pairwise(block)):
                    if _may_move(one, other):
                        moved = [*block[:place], other, one, *block[place + 2 :]]
                        yield Change(
                            "line",
                            one.lineno,
                            ast.unparse(one),
                            f"after {ast.unparse(other)}",
                            owner,
                            field,
                            moved,
                        )


def _within(function: ast.AST) -> Iterator[ast.AST]:
    """Yield the function and its blocks, without functions inside it, which come by
    themselves."""
    yield function
    for child in ast.iter_child_nodes(function):
        if not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield from _within(child)


def _may_move(one: ast.AST, other: ast.AST) -> bool:
    """Whether both are simple statements whose order may matter: one of them calls
    something, and the second does not need a name that the first gives."""
    simple = (ast.Expr, ast.Assign, ast.AugAssign)
    if not (isinstance(one, simple) and isinstance(other, simple)):
        return False
    if _is_text(one) or _is_text(other):
        return False
    given = {
        node.id
        for node in ast.walk(one)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }
    needed = {
        node.id
        for node in ast.walk(other)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
    }
    calls = any(
        isinstance(node, ast.Call) for each in (one, other) for node in ast.walk(each)
    )
    return calls and not given & needed
