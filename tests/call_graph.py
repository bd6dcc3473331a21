"""Which function of parsed C can call which, by function pointers as well."""

from collections.abc import Iterator
from typing import Any, NamedTuple

from pycparser import c_ast


def below(node: Any, *kinds: type) -> Iterator[Any]:
    """All nodes of some kinds in a tree, itself included."""
    if isinstance(node, kinds):
        yield node
    for _, child in node.children():
        yield from below(child, *kinds)


class _Function(NamedTuple):
    unit: int  # of a static function, which may share its name; -1 of others
    name: str


class CallGraph:
    """Of translation units that are linked together.

    What a pointer points to is known as far as constant structs of pointers say it: a call by a
    field reaches every function that some struct has in that field, or the one function where the
    struct is named. Functions whose address is taken in another way are reached by every pointer.
    """

    def __init__(self, units: list[Any]) -> None:
        self.units = units
        self.bodies: dict[_Function, tuple[int, Any]] = {}  # and the unit
        self.structs: dict[str, Any] = {}  # by the names that typedefs give them
        for number, unit in enumerate(units):
            for node in unit.ext:
                if isinstance(node, c_ast.FuncDef):
                    own = number if "static" in node.decl.storage else -1
                    self.bodies[_Function(own, node.decl.name)] = number, node
                elif isinstance(node, c_ast.Typedef):
                    self.structs[node.name] = node.type.type
        self.by_field: dict[str, set[_Function]] = {}
        self.by_table: dict[tuple[str, str], _Function] = {}
        self.others: set[_Function] = set()
        self._follow_pointers()

    def findings(self) -> Iterator[tuple[Any, str, str]]:
        """Calls of functions that are not here, and functions that can call themselves."""
        graph: dict[_Function, set[_Function]] = {function: set() for function in self.bodies}
        for at, (unit, function) in self.bodies.items():
            for call in below(function.body, c_ast.FuncCall):
                reached = self._reached(unit, function, call.name)
                if reached is None:
                    yield call, "call", call.name.name
                else:
                    graph[at] |= reached
        for at, (_, body) in self.bodies.items():
            found: set[_Function] = set()
            waiting = list(graph[at])
            while waiting:
                each = waiting.pop()
                if each not in found:
                    found.add(each)
                    waiting += graph[each]
            if at in found:
                yield body, "recursion", at.name

    def _find(self, unit: int, name: str) -> _Function | None:
        for at in (_Function(unit, name), _Function(-1, name)):
            if at in self.bodies:
                return at
        return None

    def _reached(self, unit: int, caller: Any, called: Any) -> set[_Function] | None:
        """Functions that a call may reach; None where it is none of these."""
        if isinstance(called, c_ast.StructRef):
            table = called.name.name if isinstance(called.name, c_ast.ID) else ""
            exact = self.by_table.get((table, called.field.name))
            found = {exact} if exact else self.by_field.get(called.field.name, set()) | self.others
            # A wrapper does not wrap a wrapper: the bindings refuse it.
            wraps = isinstance(called.name, c_ast.StructRef) and isinstance(
                called.name.name, c_ast.ID
            )
            if wraps and called.name.name.name == "inner":
                return {each for each in found if each.unit != unit}
            return found
        if isinstance(called, c_ast.ID):
            if called.name in {each.name for each in caller.decl.type.args.params}:
                return self.others
            at = self._find(unit, called.name)
            return None if at is None else {at}
        return self.others.union(*self.by_field.values())

    def _follow_pointers(self) -> None:
        for number, unit in enumerate(self.units):
            seen = {id(call.name) for call in below(unit, c_ast.FuncCall)}
            seen |= {id(reference.field) for reference in below(unit, c_ast.StructRef)}
            for declared in (d for d in unit.ext if isinstance(d, c_ast.Decl)):
                values = declared.init.exprs if isinstance(declared.init, c_ast.InitList) else []
                for field, value in zip(self._fields(declared.type), values, strict=False):
                    if isinstance(value, c_ast.NamedInitializer):
                        field, value = value.name[0].name, value.expr
                    at = self._find(number, value.name) if isinstance(value, c_ast.ID) else None
                    if at is not None:
                        self.by_field.setdefault(field, set()).add(at)
                        self.by_table[declared.name, field] = at
                        seen.add(id(value))
            for each in below(unit, c_ast.ID):
                at = self._find(number, each.name)
                if at is not None and id(each) not in seen:
                    self.others.add(at)

    def _fields(self, type_: Any) -> list[str]:
        """Names of a struct's fields, in their order; none of another type."""
        while isinstance(type_, c_ast.TypeDecl | c_ast.IdentifierType):
            named = isinstance(type_, c_ast.IdentifierType)
            type_ = self.structs.get(type_.names[0]) if named else type_.type
        decls = type_.decls if isinstance(type_, c_ast.Struct) else None
        return [field.name for field in decls or []]
