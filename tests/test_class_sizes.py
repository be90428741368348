"""A class holds one idea: none of the controllers, nor of recorded drives, has more than 20 methods.

Every `def` in the body of the class counts: properties, private and special methods, but nothing inherited.
"""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("controllers", "rover_hil/scomp")
MOST_METHODS = 20


def test_no_class_has_more_than_twenty_methods() -> None:
    counts = {
        f"{path.relative_to(ROOT)}: {node.name}": sum(isinstance(part, ast.FunctionDef) for part in node.body)
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ClassDef)
    }
    assert len(counts) > 100
    assert {name: count for name, count in counts.items() if count > MOST_METHODS} == {}
