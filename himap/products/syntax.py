"""Python source as syntax trees: what a module defines, what each definition names, and its digest."""

import ast
import hashlib
import symtable
from collections import Counter
from functools import lru_cache
from typing import NamedTuple

__all__ = ["IMPORTS", "RUN", "Code", "Part", "bound_name", "digest_of", "dump", "parse_cell", "parse_module"]

IMPORTS = (ast.Import, ast.ImportFrom)

RUN = "<run>"
"""Name of the part of a module that acts whenever the module is imported, whatever is taken from it."""

_DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
_BLOCKS = (ast.If, ast.For, ast.While, ast.With, ast.Try, ast.TryStar, ast.Match)
_SKIPPED_FIELDS = {"ctx", "kind", "type_comment", "type_params", "type_ignores"}


class Part(NamedTuple):
    """One definition, what a module does when it runs, or all of it.

    Attributes
    ----------
    digest
        Of the code, the imports at the top level aside, for they count with what they lead to.
    uses
        {name: the attributes taken of it}, None where the name is used in another way.
    local_imports
        The imports inside functions.
    """

    digest: str
    uses: dict[str, set[str] | None]
    local_imports: list[ast.stmt]


class Code:
    """The statements of a module, with an index by the name that they define.

    Attributes
    ----------
    package
        Name of the package that relative imports start from.
    is_package
        Whether this is the ``__init__`` of that package.
    index
        {name: the top-level statements that define it or change it in place}.
    """

    def __init__(self, statements, package="", is_package=False):
        self.package, self.is_package = package, is_package
        self._offered = {name for node in statements if _is_public_list(node) for name in _texts(node)}
        self._statements = [node for node in statements if not _is_text(node)]
        self._loose, self._parts, self.index = [], {}, {}
        for node in self._statements:
            names = _names_bound(node)
            for name in names:
                self.index.setdefault(name, []).append(node)
            if not names or isinstance(node, _BLOCKS):  # a loop defines its variable, and acts
                self._loose.append(node)

    def defines(self, name):
        """Whether `name` is made here, not only imported."""
        return any(not isinstance(node, IMPORTS) for node in self.index.get(name, ()))

    def part(self, name=None):
        """The `Part` called `name`, what runs on import (`RUN`), or all of the module (None)."""
        if name not in self._parts:
            self._parts[name] = self._part(name)
        return self._parts[name]

    def _part(self, name):
        imported = [bound_name(alias) for node in self._imports() for alias in node.names]
        if name is None:  # what is imported and not used is there for others, or for what it does
            nodes, extra = self._statements, imported
        elif name == RUN:  # a package imports what it neither uses nor offers for what that does
            nodes = self._loose
            extra = set(imported) - self._offered - set(self._used()) if self.is_package else ()
        else:  # a name that is imported may be there for others
            nodes, extra = self.index[name], {name} & set(imported)
        inside = [child for node in nodes for child in ast.walk(node) if child is not node]
        local = [child for child in inside if isinstance(child, IMPORTS)]
        own = [node for node in nodes if not isinstance(node, IMPORTS)]
        return Part(digest_of([dump(own)]), dict.fromkeys(extra) | _uses(nodes), local)

    def _imports(self):
        return [node for node in self._statements if isinstance(node, IMPORTS)]

    def _used(self):
        """The names that anything here uses, imports aside."""
        return _uses([node for node in self._statements if not isinstance(node, IMPORTS)])


@lru_cache(maxsize=512)
def parse_module(text, package, is_package):
    """The `Code` of the text of a module in `package`, or of that package's ``__init__``."""
    return Code(ast.parse(text).body, package, is_package)


def bound_name(alias):
    return alias.asname or alias.name.partition(".")[0]


def _names_bound(node):
    """The names that a top-level statement defines, or changes in place."""
    if isinstance(node, _DEFINITIONS):
        return {node.name}
    if isinstance(node, IMPORTS):
        return {bound_name(alias) for alias in node.names}
    bound = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    for child in ast.walk(node):  # TABLE[key] = value and thing.attribute = value change what is there
        if isinstance(child, (ast.Subscript, ast.Attribute)) and isinstance(child.ctx, ast.Store):
            bound |= {n.id for n in ast.walk(child.value) if isinstance(n, ast.Name)}
        if isinstance(child, (*_DEFINITIONS, *IMPORTS)):
            bound |= _names_bound(child)
    return bound


def _uses(nodes):
    """{name: the attributes taken of it}, None where it is used in another way, local variables left out."""
    tables, names = [symtable.symtable(ast.unparse(ast.Module(nodes, [])), "<code>", "exec")], set()
    while tables:
        table = tables.pop()
        tables += table.get_children()
        is_top = table.get_type() == "module"
        names |= {
            s.get_name() for s in table.get_symbols() if (s.is_referenced() if is_top else s.is_global())
        }
    children = [child for node in nodes for child in ast.walk(node)]
    plain = Counter(child.id for child in children if isinstance(child, ast.Name))
    dotted = [c for c in children if isinstance(c, ast.Attribute) and isinstance(c.value, ast.Name)]
    attributes = {}
    for child in dotted:
        attributes.setdefault(child.value.id, []).append(child.attr)
    return {
        name: set(attributes[name]) if len(attributes.get(name, ())) == plain[name] > 0 else None
        for name in names
    }


def _is_text(node):
    """A docstring, a bare string, or the list of public names: they change nothing."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    return _is_public_list(node)


def _is_public_list(node):
    """``__all__ = [...]``, or what is added to it."""
    targets = getattr(node, "targets", None) or [getattr(node, "target", None)]
    return any(getattr(target, "id", "") == "__all__" for target in targets)


def _texts(node):
    """The strings in a statement."""
    constants = [child.value for child in ast.walk(node) if isinstance(child, ast.Constant)]
    return [value for value in constants if isinstance(value, str)]


def dump(node):
    """A syntax tree as text, without what is no code or differs between versions of Python."""
    if isinstance(node, ast.JoinedStr):
        return f"JoinedStr({dump([item for item in node.values if not _is_blank(item)])})"
    if isinstance(node, ast.AST):
        fields = [(name, value) for name, value in ast.iter_fields(node) if name not in _SKIPPED_FIELDS]
        inner = ",".join(f"{name}={dump(value)}" for name, value in fields if value not in (None, []))
        return f"{type(node).__name__}({inner})"
    if isinstance(node, list):
        return "[" + ",".join(dump(item) for item in node if not _is_text(item)) + "]"
    return repr(node)


def _is_blank(node):
    """The empty piece that Python 3.12 leaves in the format of some f-strings, and others do not."""
    return isinstance(node, ast.Constant) and node.value == ""


def parse_cell(source):
    """The statements of a notebook cell: bare strings are some, for a notebook shows them."""
    try:
        return ast.parse(source).body
    except SyntaxError:  # a magic: no Python, it counts as text
        return [ast.Expr(ast.Constant(source))]


def digest_of(lines):
    """SHA-256 (hex) of some lines of text."""
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
