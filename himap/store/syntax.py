"""The text of a definition: only what can change a number, with holes for names of its module.

It excludes comments, docstrings, annotations (except in the body of a class, where dataclasses read them),
messages of ``raise``, ``assert`` and ``warn``, help texts, labels of progress bars, and calls of ignored
modules. It excludes names that can be chosen freely: local variables are numbered in order of appearance, and
a name of the module, defined or imported, is a hole, filled by its target. Names of parameters, attributes,
methods and fields, and strings, can be looked up, so they count; if a function looks up variables by name
(``locals()`` and similar), their names count too.
"""

import ast
from typing import NamedTuple

IMPORTS = (ast.Import, ast.ImportFrom)
DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)

_COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
_SKIPPED_FIELDS = {"ctx", "kind", "type_comment", "type_params", "type_ignores"}
_LOOK_UP = {"locals", "eval", "exec", "query"}  # look up variables by name
_SCOPES = {"vars", "dir"}  # do so without arguments
_CLASS = "<class>"

_ENTRY = {"statement", "number", "paper", "section", "figure", "notebook", "form"}
WORDS = {
    "parameter": (1, {"help"}),
    "claim": (2, _ENTRY),
    "not_applicable": (0, _ENTRY),
    "finding": (2, _ENTRY),
    "Finding": (2, {"sentence"}),
}
"""{function: (number of positional arguments that count, keywords that are text)}"""


class Hole(NamedTuple):
    """A name of the module: the statements that define it (none for ``__path__``, the folder of a package),
    the name, and the attribute of it that is used, if any."""

    nodes: list[ast.stmt]
    name: str
    attribute: str | None


class Writer:
    """Writes the text of one part of a module, and collects the `holes` in it, in order.

    It uses the `himap.store.sources.Code` of the module, the statements of the part, `nodes`, and its name,
    `own`, which is None for the cells of a notebook, whose variables count.
    """

    def __init__(self, code, own, nodes):
        self.code, self.own, self.holes = code, own, []
        self._scopes, self._n_locals = [], 0  # {name: its text, None before it is numbered, or an import}
        calls = [child for node in nodes for child in ast.walk(node) if isinstance(child, ast.Call)]
        looks_up = any(called(one) in _LOOK_UP or (called(one) in _SCOPES and not one.args) for one in calls)
        self._keeps_names = own is None or looks_up

    def text(self, node):
        """The text of a node, or of a list without docstrings, warnings and ignored calls."""
        if isinstance(node, list):
            texts = [self.text(one) for one in node if not (is_text(one) or self.is_silent(one))]
            return f"[{','.join(texts)}]"
        if not isinstance(node, ast.AST):
            return repr(node)
        return getattr(self, f"_{type(node).__name__}", self._plain)(node)

    def is_silent(self, node):
        """Whether a statement only warns, makes ignored calls, or is the `wording` of a `finding`."""
        if assigns(node, "wording") and self._is_of_himap("finding"):
            return True
        call = node.value if isinstance(node, ast.Expr) else None
        return isinstance(call, ast.Call) and (called(call) == "warn" or self._is_ignored(call.func))

    def _is_of_himap(self, name):
        """Whether a function belongs to himap: others of the same name may take numbers."""
        imports = [node for node in self.code.index.get(name, []) if isinstance(node, ast.ImportFrom)]
        modules = [self.code.package, *(node.module or "" for node in imports)]
        return any(module.partition(".")[0] == "himap" for module in modules)

    def _is_ignored(self, node):
        while isinstance(node, ast.Attribute):
            node = node.value
        return isinstance(node, ast.Name) and node.id in self.code.ignored

    def _plain(self, node, **changed):
        texts = []
        for name, value in ast.iter_fields(node):
            value = changed.get(name, value)
            if name not in _SKIPPED_FIELDS and value not in (None, []):
                is_name = name in ("name", "rest") and isinstance(value, str)  # of except, match and the like
                texts.append(f"{name}={self._name(value) if is_name else self.text(value)}")
        return f"{type(node).__name__}({','.join(texts)})"

    def _name(self, name, attribute=None):
        """A variable: its number, or its name; a hole if it is a name of the module."""
        for scope in reversed(self._scopes):
            if name in scope and (scope is self._scopes[-1] or _CLASS not in scope):
                if isinstance(scope[name], ast.stmt):
                    return self._hole([scope[name]], name, attribute)
                if scope[name] is None:
                    scope[name], self._n_locals = f"v{self._n_locals}", self._n_locals + 1
                return scope[name]
        if name == self.own:
            return "own"
        nodes = self.code.index.get(name, [])
        if nodes and (self.own is not None or all(isinstance(node, IMPORTS) for node in nodes)):
            return self._hole(nodes, name, attribute)
        return self._hole([], name, None) if name == "__path__" else repr(name)

    def _hole(self, nodes, name, attribute):
        if name in self.code.ignored:
            return f"ignored {attribute or name!r}"
        self.holes.append(Hole(nodes, name, attribute))
        return "@"

    def _Name(self, node):
        return self._name(node.id)

    def _Attribute(self, node):
        if not isinstance(node.value, ast.Name):
            return f"{self.text(node.value)}.{node.attr}"
        n_holes = len(self.holes)
        value = self._name(node.value.id, node.attr)
        return value if self.holes[n_holes:] and self.holes[-1].attribute else f"{value}.{node.attr}"

    def _JoinedStr(self, node):  # Python 3.12 keeps empty pieces in some formats
        values = [item for item in node.values if not (isinstance(item, ast.Constant) and item.value == "")]
        return f"JoinedStr({self.text(values)})"

    def _Raise(self, node):
        return f"Raise({self.text(getattr(node.exc, 'func', node.exc))})"

    def _Assert(self, node):
        return self._plain(node, msg=None)

    def _AnnAssign(self, node):
        if (self._scopes and _CLASS in self._scopes[-1]) or node.value is None:
            return self._plain(node)
        return self._plain(ast.Assign([node.target], node.value))

    def _Call(self, node):
        args, keywords = node.args, node.keywords
        if called(node) in WORDS and self._is_of_himap(called(node)):
            n_args, words = WORDS[called(node)]
            args, keywords = args[:n_args], [key for key in keywords if key.arg not in words]
        elif self._is_ignored(node.func):
            if called(node) == "progress" and args:
                return self.text(args[0])
            args = [item for item in args if not _is_string(item)]
            keywords = [item for item in keywords if not _is_string(item.value)]
        elif not self.code.keeps_labels:
            keywords = [item for item in keywords if not (item.arg == "label" and _is_string(item.value))]
        return self._plain(node, args=args, keywords=keywords)

    def _Import(self, node):
        """In a function, an import counts where the name is used."""
        if not self._scopes:
            self.holes += [Hole([node], bound_name(alias), None) for alias in node.names]
        return ""

    _ImportFrom = _Import

    def _FunctionDef(self, node):
        decorators = [
            one
            for one in node.decorator_list
            if not self._is_ignored(getattr(one, "func", one))
            or any(key.arg == "version" for key in getattr(one, "keywords", ()))
        ]
        return f"Def({self._name(node.name)},{self.text(decorators)},{self._function(node, node.body)})"

    _AsyncFunctionDef = _FunctionDef

    def _Lambda(self, node):
        return f"Lambda({self._function(node, [node.body])})"

    def _function(self, node, body):
        args = node.args
        groups = [args.posonlyargs, args.args, [args.vararg], args.kwonlyargs, [args.kwarg]]
        names = [[one.arg for one in group if one] for group in groups]
        given = [self.text(one) if one else "none" for one in [*args.defaults, *args.kw_defaults]]
        parameters = {name: repr(name) for group in names for name in group}
        return f"{names},{self._inside(self._free(_bound_in(body)) | parameters, given, body)}"

    def _free(self, names):
        return {name: text or (repr(name) if self._keeps_names else None) for name, text in names.items()}

    def _inside(self, names, before, *nodes):
        """The texts of some nodes in a new scope, after those written outside it."""
        self._scopes.append(names)
        text = ",".join([*before, *map(self.text, nodes)])
        self._scopes.pop()
        return text

    def _comprehension_of(self, node):
        loops, first = node.generators, self.text(node.generators[0].iter)
        names = dict.fromkeys(names_in(one.target for one in loops))
        heads = [(one.target, ast.Tuple(one.ifs), ast.Constant(one.is_async)) for one in loops]
        parts = [part for head in heads for part in head]
        made = [getattr(node, field) for field in ("key", "value", "elt") if hasattr(node, field)]
        inside = self._inside(self._free(names), [first], parts, [one.iter for one in loops[1:]], made)
        return f"{type(node).__name__}({inside})"

    _ListComp = _SetComp = _DictComp = _GeneratorExp = _comprehension_of

    def _ClassDef(self, node):
        before = [self._name(node.name), self.text([*node.decorator_list, *node.bases, *node.keywords])]
        names = {name: repr(name) for name in _bound_in(node.body)} | {_CLASS: ""}
        return f"Class({self._inside(names, before, node.body)})"


def _bound_in(body):
    """{name: None, or the import that binds it} for the names bound in the body of a function or class."""
    bound, elsewhere, todo = {}, set(), list(body)
    while todo:
        node = todo.pop()
        if isinstance(node, IMPORTS):
            bound |= {bound_name(alias): node for alias in node.names}
        elif isinstance(node, (ast.Global, ast.Nonlocal)):
            elsewhere |= set(node.names)
        elif isinstance(node, _COMPREHENSIONS):  # their variables have a separate scope
            todo += [child for child in ast.walk(node) if isinstance(child, ast.NamedExpr)]
        elif not isinstance(node, ast.Lambda):
            is_stored = isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
            name = node.id if is_stored else getattr(node, "name", None) or getattr(node, "rest", None)
            if isinstance(name, str):
                bound.setdefault(name)
            todo += [] if isinstance(node, DEFINITIONS) else ast.iter_child_nodes(node)
    return {name: import_ for name, import_ in bound.items() if name not in elsewhere}


def names_bound(node):
    """The names that a top-level statement defines or changes in place."""
    if isinstance(node, DEFINITIONS):
        return {node.name}
    places = [one for one in ast.walk(node) if isinstance(one, (ast.Subscript, ast.Attribute))]
    # TABLE[key] = value changes TABLE
    return names_in(one.value for one in places if isinstance(one.ctx, ast.Store)) | _bound_in([node]).keys()


def names_in(nodes):
    return {one.id for node in nodes for one in ast.walk(node) if isinstance(one, ast.Name)}


def bound_name(alias):
    return alias.asname or alias.name.partition(".")[0]


def called(node):
    """The last name of a called function, or of a bare decorator."""
    node = getattr(node, "func", node)
    return getattr(node, "attr", "") or getattr(node, "id", "")


def assigns(node, name):
    """Whether a statement assigns a value to `name`."""
    targets = getattr(node, "targets", None) or [getattr(node, "target", None)]
    value = getattr(node, "value", None)  # a loop has a target and no value
    return any(getattr(one, "id", "") == name for one in targets) and isinstance(value, ast.AST)


def is_text(node):
    """Whether a node is a docstring, a bare string, or the list of public names, which have no effect."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    return assigns(node, "__all__")


def _is_string(node):
    return isinstance(node, ast.JoinedStr) or isinstance(getattr(node, "value", None), str)
