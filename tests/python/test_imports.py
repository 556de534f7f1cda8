"""Which module imports which: the product stands alone, and imports run in no circle.

The graph is read from the sources: imports at the top of a module and in its functions alike, less
those for type checkers. That the packages of a module are imported before it does not count.
"""

from __future__ import annotations

import ast
from collections.abc import Container, Iterable, Iterator
from pathlib import Path

from tests.python.test_build_rules import PACKAGES, ROOT

#: The modules of the product that import its proof and its benches, when their command is given.
COMMANDS = {
    "veriray_validate": "veriray.commands.validate",
    "veriray_bench": "veriray.commands.bench",
}
Graph = dict[str, set[str]]


def modules() -> dict[str, Path]:
    """Files by the names of their modules."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / "python" / package).rglob("*.py")):
            parts = path.relative_to(ROOT / "python").with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(nodes: Iterable[ast.AST]) -> Iterator[ast.Import | ast.ImportFrom]:
    """Import statements among the nodes and within them, less those for type checkers."""
    for node in nodes:
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            yield node
        elif isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            yield from imports(node.orelse)
        else:
            yield from imports(ast.iter_child_nodes(node))


def targets(node: ast.Import | ast.ImportFrom, package: str, known: Container[str]) -> set[str]:
    """The known modules that a statement in a module of `package` imports."""
    if isinstance(node, ast.Import):
        found = {alias.name for alias in node.names}
    else:
        parts = package.split(".")
        above = parts[: len(parts) + 1 - node.level] if node.level else []
        base = ".".join([*above, *([node.module] if node.module else [])])
        full = (f"{base}.{alias.name}" for alias in node.names)
        found = {name if name in known else base for name in full}
    return {name for name in found if name in known}


def graph() -> Graph:
    """Module -> the modules of the three packages that it imports."""
    files = modules()
    result: Graph = {}
    for module, path in files.items():
        package = module if path.name == "__init__.py" else module.rpartition(".")[0]
        found = imports(ast.parse(path.read_text("utf-8")).body)
        result[module] = {name for node in found for name in targets(node, package, files)}
        result[module] -= {module}
    return result


def circles(graph: Graph) -> set[frozenset[str]]:
    """Sets of more than one module each of which leads to every other."""
    reached = {}
    for start in graph:
        seen: set[str] = set()
        todo = [start]
        while todo:
            new = graph[todo.pop()] - seen
            seen |= new
            todo += new
        reached[start] = seen
    return {
        frozenset(other for other in reached[start] if start in reached[other])
        for start in graph
        if start in reached[start]
    }


def test_product_imports_neither_proof_nor_benches() -> None:
    found = {
        (module, target.partition(".")[0])
        for module, loaded in graph().items()
        for target in loaded
        if module.partition(".")[0] == "veriray" != target.partition(".")[0]
    }
    assert found == {(module, package) for package, module in COMMANDS.items()}


def test_proof_imports_no_bench() -> None:
    for module, loaded in graph().items():
        if module.startswith("veriray_validate"):
            assert not [name for name in loaded if name.startswith("veriray_bench")], module


def test_imports_run_in_no_circle() -> None:
    assert not circles(graph())


def test_circles_are_found() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == {frozenset("bc")}
    code = (
        "if TYPE_CHECKING:\n    import a\nelse:\n    import b\n"
        "def f():\n    from . import c\n    from ..d import e\n"
    )
    known = {"a", "b", "p.q", "p.q.c", "p.d"}
    found = [targets(node, "p.q", known) for node in imports(ast.parse(code).body)]
    assert found == [{"b"}, {"p.q.c"}, {"p.d"}]
