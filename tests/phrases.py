"""The prose of a file: what a reader of the program, its documents or its code reads as a sentence."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

NAME = re.compile(r"`[^`\s]*`")
"""A quoted name: an identifier, a key, a topic, a command or an option has no space."""


def prose_of(path: Path) -> str:
    """Return the sentences of a file, without quoted names; a file that is not Python is prose throughout."""
    text = path.read_text("utf-8")
    return NAME.sub("", "\n\n".join(_python_prose(text)) if path.suffix == ".py" else text)


def _python_prose(source: str) -> Iterator[str]:
    """Yield the comments of Python code, lines that follow each other as one, and its string literals."""
    last_line = -1
    comment = ""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            if token.start[0] != last_line + 1:
                yield comment
                comment = ""
            comment = f"{comment} {token.string.lstrip('# ')}"
            last_line = token.start[0]
    yield comment
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "0" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
