"""A lint for C that flies: nothing that a small controller lacks, nothing that assumes its widths.

A TI C2000 has a char and an int of 16 bits. The files are preprocessed against headers of such a
machine (``export/headers``) and parsed; the rules look at the tree:

====================  ==============================================================================
header                a library header besides float.h, stdbool.h, stddef.h and stdint.h
call                  a function that is not among these files: malloc, printf, sqrt, memcpy ...
recursion             a function that can call itself, by function pointers as well
variable              a variable that is not const and outlives a call
variable-length       an array whose length the compiler does not know
array                 an array longer than an int of 16 bits can count
char                  char, a type of 8 bits, characters and texts
double                double, in a build for float
literal               a whole number that its type of 16 bits does not hold
shift                 a shift of what is signed, by what is no constant, or by more than it has bits
====================  ==============================================================================
"""

import re
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from call_graph import CallGraph, below
from pycparser import CParser, c_ast

HEADERS = Path(__file__).parent / "export" / "headers"
ALLOWED = {header.name for header in HEADERS.glob("*.h")}
MOST = 32767  # of an int of 16 bits


class Finding(NamedTuple):
    rule: str
    file: str
    line: int
    what: str


def lint(folder: Path, files: Iterable[str], includes: Iterable[str], *, real: str) -> set[Finding]:
    """Return all findings.

    Parameters
    ----------
    folder : Path
        What all names are relative to.
    files : iterable of str
        C files and headers.
    includes : iterable of str
        Options ``-I`` for the preprocessor.
    real : {"float", "double"}
        What the files compute in.
    """
    files = list(files)
    found = {f for name in files for f in _headers(folder, name)}
    if found:
        return found
    units = [_parsed(folder, name, includes) for name in files if name.endswith(".c")]
    names = _Names(units)
    for unit in units:
        for node in unit.ext:
            if not str(node.coord.file).startswith(str(HEADERS)):
                found |= {_at(node, *each) for node, *each in _Rules(names, real).check(node)}
    return found | {_at(node, rule, name) for node, rule, name in CallGraph(units).findings()}


def _headers(folder: Path, name: str) -> Iterator[Finding]:
    for number, line in enumerate((folder / name).read_text().splitlines(), 1):
        header = re.match(r"\s*#\s*include\s*<(.*?)>", line)
        if header and header[1] not in ALLOWED:
            yield Finding("header", name, number, header[1])


def _parsed(folder: Path, name: str, includes: Iterable[str]) -> Any:
    # -undef: no __GNUC__, and so no extensions.
    command = ["cc", "-E", "-std=c99", "-undef", "-nostdinc", f"-I{HEADERS}", *includes, name]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    return CParser().parse(done.stdout, name)


def _at(node: Any, rule: str, what: str) -> Finding:
    return Finding(rule, str(node.coord.file), node.coord.line, what)


class _Names:
    """What the files declare: functions, types of fields and results, typedefs."""

    def __init__(self, units: list[Any]) -> None:
        self.functions: dict[str, Any] = {}
        self.typedefs: dict[str, Any] = {}
        self.fields: dict[str, Any] = {}
        self.globals: dict[str, Any] = {}
        for unit in units:
            for node in unit.ext:
                if isinstance(node, c_ast.FuncDef):
                    self.functions[node.decl.name] = node
                elif isinstance(node, c_ast.Typedef):
                    self.typedefs[node.name] = node.type
                elif isinstance(node, c_ast.Decl) and node.name:
                    self.globals[node.name] = node.type
                for struct in below(node, c_ast.Struct, c_ast.Union):
                    for field in struct.decls or []:
                        self.fields.setdefault(field.name, field.type)

    def width(self, type_: Any) -> tuple[int, bool]:
        """Bits of a type where int has 16, and whether it is signed; 0 where it is no integer."""
        while not isinstance(type_, c_ast.IdentifierType):
            if isinstance(type_, c_ast.Struct | c_ast.Union | c_ast.Enum | c_ast.PtrDecl):
                return (16, True) if isinstance(type_, c_ast.Enum) else (0, False)
            type_ = type_.type
        words = type_.names
        if words[0] in self.typedefs:
            return self.width(self.typedefs[words[0]])
        if {"float", "double", "void"} & set(words):
            return 0, False
        return 16 * 2 ** words.count("long"), not {"unsigned", "_Bool"} & set(words)


class _Rules(c_ast.NodeVisitor):
    """The rules that look at one declaration or function."""

    def __init__(self, names: _Names, real: str) -> None:
        self.names, self.real = names, real
        self.local: dict[str, Any] = {}
        self.found: list[tuple[Any, str, str]] = []

    def check(self, node: Any) -> list[tuple[Any, str, str]]:
        if isinstance(node, c_ast.Decl):
            self._lasting(node)
        self.visit(node)
        return self.found

    def _lasting(self, node: Any) -> None:
        """A declaration whose variable outlives a call."""
        type_ = node.type
        while isinstance(type_, c_ast.ArrayDecl):
            type_ = type_.type
        if isinstance(type_, c_ast.TypeDecl | c_ast.PtrDecl) and "const" not in type_.quals:
            self.found.append((node, "variable", node.name))

    def visit_Decl(self, node: Any) -> None:
        self.local[node.name] = node.type
        if "static" in node.storage and not isinstance(node.type, c_ast.FuncDecl):
            self._lasting(node)
        self.generic_visit(node)

    def visit_ArrayDecl(self, node: Any) -> None:
        length = None if node.dim is None else _constant(node.dim)
        if node.dim is not None and length is None:
            self.found.append((node, "variable-length", "array"))
        elif length is not None and length > MOST:
            self.found.append((node, "array", str(length)))
        self.generic_visit(node)

    def visit_IdentifierType(self, node: Any) -> None:
        words = set(node.names)
        for rule, banned in (("char", {"char", "int8_t", "uint8_t"}), ("double", {"double"})):
            if words & banned and not (rule == "double" == self.real):
                self.found.append((node, rule, " ".join(node.names)))

    def visit_Constant(self, node: Any) -> None:
        if node.type in ("char", "string"):
            self.found.append((node, "char", node.value))
        elif node.type == "double" and self.real == "float":
            self.found.append((node, "double", node.value))
        elif "int" in node.type:
            bits, signed = _literal(node.value)
            if _constant(node) >= 2 ** (bits - signed):
                self.found.append((node, "literal", node.value))

    def visit_BinaryOp(self, node: Any) -> None:
        if node.op in ("<<", ">>"):
            self._shift(node, node.left, node.right)
        self.generic_visit(node)

    def visit_Assignment(self, node: Any) -> None:
        if node.op in ("<<=", ">>="):
            self._shift(node, node.lvalue, node.rvalue)
        self.generic_visit(node)

    def _shift(self, node: Any, what: Any, by: Any) -> None:
        (bits, signed), count = self._width(what), _constant(by)
        if signed or count is None or count >= bits:
            sort = f"{'' if signed else 'un'}signed"
            self.found.append((node, "shift", f"{sort}, {bits} bits, by {count}"))

    def _width(self, node: Any) -> tuple[int, bool]:
        """Bits of an expression, and whether it is signed; never more than it has for certain."""
        match node:
            case c_ast.Constant():
                return _literal(node.value)
            case c_ast.ID():
                names = self.names
                return names.width(self.local.get(node.name) or names.globals[node.name])
            case c_ast.StructRef():
                return self.names.width(self.names.fields[node.field.name])
            case c_ast.ArrayRef():
                return self._width(node.name)
            case c_ast.Cast():
                return self.names.width(node.to_type)
            case c_ast.FuncCall():
                return self.names.width(self.names.functions[node.name.name].decl.type)
            case c_ast.UnaryOp():
                return self._width(node.expr)
            case c_ast.TernaryOp():
                return self._wider(node.iftrue, node.iffalse)
            case c_ast.BinaryOp() if node.op in ("<<", ">>"):
                return self._width(node.left)
            case c_ast.BinaryOp() if node.op in ("+", "-", "*", "/", "%", "&", "|", "^"):
                return self._wider(node.left, node.right)
        return 16, True

    def _wider(self, left: Any, right: Any) -> tuple[int, bool]:
        a, b = self._width(left), self._width(right)
        bits = max(a[0], b[0])
        return bits, all(signed for width, signed in (a, b) if width == bits)


def _literal(text: str) -> tuple[int, bool]:
    """Bits that the suffix of a whole number gives it, and whether it is signed."""
    suffix = text.lower().lstrip("0123456789abcdefx") if "x" in text.lower() else text.lower()
    return 16 * 2 ** suffix.count("l"), "u" not in suffix


def _constant(node: Any) -> int | None:
    """Value of a constant expression, or None."""
    match node:
        case c_ast.Constant() if "int" in node.type:
            return int(node.value.rstrip("uUlL"), 0)
        case c_ast.BinaryOp() if node.op in ("+", "-", "*"):
            a, b = _constant(node.left), _constant(node.right)
            if a is None or b is None:
                return None
            return {"+": a + b, "-": a - b, "*": a * b}[node.op]
    return None
