"""Mutates what keeps a vibration safe, runs the unit tests of its room on each mutant,
and prints those that survive.

A mutant changes one operator, number, condition or compared string in memory; message
texts and docstrings stay. Each is tested in a process forked from one that has the
libraries already. A mutant that no test kills is a promise that no test holds, or an
equivalent one: no input tells it from the original.

    python scripts/mutants.py --files limits,gate --share 0.2 --seed 1
"""

import argparse
import ast
import contextlib
import copy
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import io
import os
import random
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import hypothesis
import pytest

ROOT = Path(__file__).parents[1]
TARGETS = {  # the file, and the tests of its room; those that kill most come first
    "limits": (
        "signal/haptics/limits.py",
        "test_limits.py test_mapping.py test_profiles.py",
    ),
    "watchdog": ("live/runtime/watchdog.py", "test_watchdog.py"),
    "decision": ("signal/perception/decision.py", "test_decision.py test_engine.py"),
    "gate": (
        "live/runtime/output_gate.py",
        "test_output_gate.py test_finger_output.py",
    ),
    "security": ("faces/web/security.py", "test_security.py"),
    "oscillator": (
        "signal/haptics/oscillator.py",
        "test_oscillator.py test_playback.py test_waveform.py",
    ),
    "session": (
        "net/link/session.py",
        "test_session_bounds.py test_session.py test_renewal.py "
        "test_hostile_callers.py test_session_states.py",
    ),
}
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
NOT_CODE = {"annotation", "returns", "decorator_list", "type_params"}
TEXTS = (
    ast.Compare,
    ast.MatchValue,
    ast.Dict,
    ast.List,
    ast.Tuple,
)  # a string in one of these is no message


class Mutant(NamedTuple):
    line: int
    old: str
    new: str
    tree: ast.Module


class _Loader(importlib.machinery.SourceFileLoader):
    """Imports one module from a changed tree."""

    def __init__(self, name: str, path: str, tree: ast.Module) -> None:
        super().__init__(name, path)
        self._tree = tree

    def get_code(self, fullname: str) -> Any:
        return compile(ast.fix_missing_locations(self._tree), self.path, "exec")


class _Finder(importlib.abc.MetaPathFinder):
    def __init__(self, loader: _Loader) -> None:
        self._loader = loader

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        if fullname == self._loader.name:
            return importlib.util.spec_from_file_location(
                fullname, self._loader.path, loader=self._loader
            )
        return None


def variants(node: ast.AST, parent: ast.AST, field: str) -> Iterator[ast.AST]:
    """Yield what may stand in a node's place."""
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
        case ast.Constant(value=str(value)) if isinstance(parent, TEXTS):
            yield ast.Constant(value + "x")
        case ast.Name(id="min" | "max" as name) if field == "func":
            yield ast.Name("max" if name == "min" else "min", ast.Load())
    if field == "test" and not isinstance(node, ast.Compare | ast.UnaryOp):
        yield ast.UnaryOp(ast.Not(), node)  # type: ignore[arg-type]


def places(node: ast.AST) -> Iterator[tuple[ast.AST, str, int, ast.AST]]:
    """Yield the parent, field, index (-1: the field itself) and node of everything
    under ``node`` that is code."""
    for field, value in ast.iter_fields(node):
        if field in NOT_CODE:
            continue
        for index, child in (
            enumerate(value) if isinstance(value, list) else [(-1, value)]
        ):
            if isinstance(child, ast.AST) and not _is_text(child):
                yield node, field, index, child
                yield from places(child)


def _is_text(node: ast.AST) -> bool:
    """Whether a node is a docstring, a formatted message, what raises one, or a
    type."""
    match node:
        case ast.JoinedStr() | ast.Raise() | ast.Expr(value=ast.Constant()):
            return True
        case ast.Subscript(value=ast.Name(id="Literal")):
            return True
    return False


def mutants(source: str) -> Iterator[Mutant]:
    tree = ast.parse(source)
    for parent, field, index, node in list(places(tree)):
        for new in variants(node, parent, field):
            siblings = getattr(parent, field)
            setattr(
                parent,
                field,
                [*siblings[:index], new, *siblings[index + 1 :]] if index >= 0 else new,
            )
            line = getattr(node, "lineno", getattr(parent, "lineno", 0))
            yield Mutant(line, ast.unparse(node), ast.unparse(new), copy.deepcopy(tree))
            setattr(parent, field, siblings)


def survives(path: Path, tree: ast.Module, tests: list[str], limit: float) -> bool:
    """Whether all tests pass on a mutant, in a process of its own that ends after
    ``limit`` seconds."""
    if child := os.fork():
        return os.waitpid(child, 0)[1] == 0
    signal.alarm(max(1, round(limit)))
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(nothing, stream)
    try:
        name = module_name(path)
        sys.meta_path.insert(0, _Finder(_Loader(name, str(path), tree)))
        importlib.import_module(name)
        failed = int(
            pytest.main(
                [
                    "-x",
                    "-m",
                    "not realtime and not package and not slow",
                    "-p",
                    "no:rerunfailures",
                    *tests,
                ]
            )
        )
    except BaseException:
        failed = 1
    os._exit(failed)


def module_name(path: Path) -> str:
    return ".".join(
        path.relative_to(ROOT / "packages/tactophone/src").with_suffix("").parts
    )


def tests_of(name: str) -> list[str]:
    """Paths of the file, for its examples, and of its tests."""
    file, tests = TARGETS[name]
    room = ROOT / "packages/tactophone/tests" / Path(file).parent
    return [
        str(ROOT / "packages/tactophone/src/tactophone" / file),
        *(str(room / test) for test in tests.split()),
    ]


def run(name: str, share: float, seed: int) -> tuple[int, int]:
    """Test a share of one file's mutants; print the survivors, and return how many were
    tested and survived."""
    file, wanted = TARGETS[name][0], tests_of(name)
    path = ROOT / "packages/tactophone/src/tactophone" / file
    begin = time.monotonic()
    if not survives(path, ast.parse(path.read_text("utf-8")), wanted, 600):
        sys.exit(f"{file}: its tests fail already; run pytest {' '.join(wanted)}")
    limit = 5 + 4 * (time.monotonic() - begin)
    chosen = list(mutants(path.read_text("utf-8")))
    if share < 1:
        chosen = random.Random(seed).sample(chosen, max(1, round(share * len(chosen))))
    alive = 0
    for mutant in chosen:
        if survives(path, mutant.tree, wanted, limit):
            alive += 1
            print(f"{file}:{mutant.line} {mutant.old} -> {mutant.new}", flush=True)
    killed = len(chosen) - alive
    print(
        f"{file}: {len(chosen)} mutants, {killed} killed, {alive} survived "
        f"({killed / len(chosen):.0%})",
        flush=True,
    )
    return len(chosen), alive


def main() -> None:
    parser = argparse.ArgumentParser(
        description=str(__doc__).split("\n", maxsplit=1)[0]
    )
    parser.add_argument(
        "--files", default=",".join(TARGETS), help="names, with commas between them"
    )
    parser.add_argument(
        "--share",
        type=float,
        default=1.0,
        help="of each file's mutants, chosen at random",
    )
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if unknown := set(options.files.split(",")) - TARGETS.keys():
        parser.error(
            f"no file is called {', '.join(unknown)}: name some of {', '.join(TARGETS)}"
        )
    os.chdir(ROOT)
    os.environ["HYPOTHESIS_PROFILE"] = "few"
    hypothesis.settings.register_profile(
        "few", max_examples=20, derandomize=True, deadline=None
    )
    # Every mutant has the libraries of all tests then, and imports our own modules
    # anew.
    with contextlib.redirect_stdout(io.StringIO()):
        pytest.main(
            [
                "--collect-only",
                *(test for name in options.files.split(",") for test in tests_of(name)),
            ]
        )
    for module in [
        module
        for module in sys.modules
        if module.split(".")[0] in ("tactophone", "tests")
    ]:
        del sys.modules[module]
    for name in options.files.split(","):
        run(name, options.share, options.seed)


if __name__ == "__main__":
    main()
