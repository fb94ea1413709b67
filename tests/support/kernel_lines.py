"""Which lines of compiled functions the tests compile, told at the end of a run: a pytest plugin of ``make coverage``.

Coverage tools see no line of a kernel, as Python never runs it. Taichi reads each line that it compiles, leaving out
what is not taken of branches that are decided at compile time (``ti.static``). Both ways of a branch that is decided
on the device count, whichever is taken. Child processes do not count.
"""

import ast
import json
import os
from collections import defaultdict
from itertools import groupby
from pathlib import Path

COMPILED = {"func", "kernel", "law", "law_with_derivative"}  # decorators
SOURCES = ("taichi_sim", "robots", "optim")
read: dict[str, set[int]] = defaultdict(set)


def pytest_configure(config):
    """Watch Taichi read; the process that gathers forgets what earlier runs have left."""
    from taichi.lang.ast.ast_transformer_utils import Builder

    import taichi_sim.lattice  # noqa: F401 - which imports Taichi without its warnings

    build = Builder.__call__

    def watched(self, ctx, node):
        if isinstance(node, ast.stmt):
            read[ctx.file].add(node.lineno + ctx.lineno_offset)
        return build(self, ctx, node)

    Builder.__call__ = watched
    if not hasattr(config, "workerinput"):
        for path in _folder(config).iterdir():
            path.unlink()


def pytest_sessionfinish(session):
    """Keep what this process has read."""
    found = {os.path.relpath(file, session.config.rootpath): sorted(lines) for file, lines in read.items()}
    (_folder(session.config) / f"{os.getpid()}.json").write_text(json.dumps(found))


def pytest_terminal_summary(terminalreporter, config):
    """Tell the lines that no process has read."""
    known: dict[str, set[int]] = defaultdict(set)
    for path in _folder(config).iterdir():
        for file, lines in json.loads(path.read_text()).items():
            known[file] |= set(lines)
    total, missing = 0, {}
    for path in sorted(path for folder in SOURCES for path in (config.rootpath / folder).rglob("*.py")):
        file, lines = os.path.relpath(path, config.rootpath), compiled_lines(path.read_text())
        total += len(lines)
        if left := sorted(lines - known[file]):
            missing[file] = left
    count = sum(map(len, missing.values()))
    terminalreporter.section("lines of kernels that no test compiles")
    for file, left in missing.items():
        terminalreporter.write_line(f"{file}: {ranges(left)}")
    share = 100 * (1 - count / total)
    terminalreporter.write_line(f"{total} statements in compiled functions, {count} not compiled: {share:.1f} %")


def compiled_lines(source):
    """Lines on which statements of compiled functions begin."""
    lines = set()
    for function in ast.walk(ast.parse(source)):
        if isinstance(function, ast.FunctionDef) and COMPILED & set(map(_name, function.decorator_list)):
            for node in (node for statement in function.body for node in ast.walk(statement)):
                if isinstance(node, ast.stmt) and not _is_text(node):
                    lines.add(node.lineno)
    return lines


def ranges(lines):
    """Ascending numbers as text, those that follow one another as ``first-last``."""
    runs = groupby(enumerate(lines), key=lambda pair: pair[1] - pair[0])
    ends = [[line for _, line in run] for _, run in runs]
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in ends)


def _folder(config):
    return Path(config.cache.mkdir("kernel-lines"))


def _name(decorator):
    target = decorator.func if isinstance(decorator, ast.Call) else decorator
    return target.attr if isinstance(target, ast.Attribute) else getattr(target, "id", "")


def _is_text(node):
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
