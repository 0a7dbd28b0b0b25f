"""Fingerprints of code: which result depends on which lines.

A fingerprint is a digest of the text of code (`himap.store.syntax`: what can change a number, and nothing
else) and of all that this names: definitions of its own module, what it imports of others, and what a package
offers under a name. A definition counts by its text and by the digests of what it names, in their order, not
by its name or place: to rename or move it changes nothing. Definitions that name each other in a circle get
digests that say how they do. What each module on the way, and each package that it is in, does when it is
imported counts too, and the imports of a package that are neither used there nor offered in ``__all__``, so
that they are there for what they do (say, to register).

Products, and classes with a fixed ``name`` such as methods and beams, have a digest of their own, and count
elsewhere by that name. So the fingerprint of a notebook or a record is a dict: "code", "look", and the digest
of every product and named class that it reaches, by its name. Where code names ``__path__`` and so looks into
the folder of a package, it reaches all named classes there; one that is added later was not used, and `moved`
asks only for the names that were listed.

What only shows numbers (`himap.store.sources.LOOKS`) counts in "look", what that names elsewhere in "code".
Other packages count by name: a new numpy makes nothing stale. Code that gives the numbers of former code
(`himap.store.verify`) counts as that. All is read from the source: nothing is imported.
"""

import json
from collections import defaultdict, namedtuple
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
from typing import NamedTuple

from himap.core.errors import InputError
from himap.store.sources import ROOT, RUN, digest_of, is_ignored, is_look, parse, parse_cells
from himap.store.syntax import IMPORTS, bound_name

ACCEPTED = ROOT.parent / "book" / "results" / "accepted.json"
"""Of a checkout: {digest of a definition, or of all behind a product: one with the same numbers}."""

PROBES = ACCEPTED.with_name("probes.json")
"""The numbers that code is compared with (`himap.store.verify`)."""

_FOLDER, _CELLS = "__path__", "<cells>"


def stored_dict(path):
    """What `ACCEPTED` or `PROBES` holds; nothing where there is no checkout."""
    try:
        return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    except ValueError as error:
        raise InputError(
            f"{path} is no JSON ({error}), perhaps after a merge: restore it with `git checkout`, and run "
            "`himap verify`."
        ) from None


def accepted_version():
    """What changes when `ACCEPTED` does."""
    return ACCEPTED, ACCEPTED.stat().st_mtime_ns if ACCEPTED.is_file() else None


def moved(stored, today, *, looks=False):
    """The names under which a stored fingerprint is another today: empty if what was made of it is fresh.

    Both are {"code", "look", name of a product or class, path of a file from "./": digest}. A name that only
    `today` has, say of a new method, moves nothing; a file does. What is no dict, as it was once kept, cannot
    be compared. What only shows numbers counts with `looks`.
    """
    if not (isinstance(stored, dict) and isinstance(today, dict)):
        return ["code"]
    names = [*stored, *(name for name in today if name.startswith("./") and name not in stored)]
    return [name for name in names if (looks or name != "look") and stored.get(name) != today.get(name)]


class _Unit(NamedTuple):
    """What (module, name) is: digest of its text; what each hole leads to, [(units, attribute)]; and further
    units that count for what they do when they are imported."""

    text: str
    targets: tuple = ()
    others: tuple = ()

    @property
    def edges(self):
        return [*(unit for units, _ in self.targets for unit in units), *self.others]


_Summary = namedtuple("_Summary", "code look parts reached")


class CodeTree:
    """The source of one or more packages, as the graph of what depends on what.

    Parameters
    ----------
    texts
        {path of a file: text} that counts in place of what is on disk, such as `himap.store.sources.LOADED`.
    accepted
        {digest of a definition: the one that it counts as}; default: those in `ACCEPTED`.
    former
        {place of a definition (see `parts_of`): former digest that it is to count as}; what follows is
        in the attribute `accepts`, a dict as `accepted`.
    formers
        All former digests, of which none is accepted for another; those of `former` unless given.
    roots
        Name of another package (or single module) -> its folder (or file).
    """

    def __init__(self, *, texts=None, accepted=None, former=None, formers=None, **roots):
        self.texts = texts or {}
        self._accepted = stored_dict(ACCEPTED) if accepted is None else accepted
        self._former, self.accepts, self._digests = former or {}, {}, {}
        self._formers = formers or frozenset(self._former.values())
        self._files = {}  # {module: its file}
        for name, path in {"himap": ROOT, **roots}.items():
            root = Path(path)
            for file in [root] if root.suffix == ".py" else {*root.rglob("*.py"), *self.texts}:
                if root in (file, *file.parents):
                    parts = file.relative_to(root.parent).with_suffix("").parts[1:]
                    self._files[".".join([name, *parts]).removesuffix(".__init__")] = file
        for method in ("_summary", "_unit", "_fixed_name", "_read"):
            setattr(self, method, cache(getattr(self, method)))

    def fingerprint(self, module, name=None):
        """{"code", "look", products and named classes: digest} of a module, or of `name` in it."""
        return self.source_fingerprint(f"from {module} import {name}" if name else f"import {module}")

    def source_fingerprint(self, *sources):
        """The same of pieces of code, such as the cells of a notebook, and of what they import."""
        root, codes = (_CELLS, sources), defaultdict(list)
        for part in self._parts(root):
            codes[self._fixed_name(part)].append(self._summary(part).code)
        named = {name: one[0] if len(one) == 1 else digest_of(sorted(one)) for name, one in codes.items()}
        code, look, *_ = self._summary(root)
        return {"code": code, "look": look} | dict(sorted(named.items()))

    def parts_of(self, module):
        """{fixed name: (those that its own code names, {place: digest} of the definitions behind it)}.

        Of every product and named class of a module. The place is ``module:name``, or the fixed name.
        """
        parts = {}
        for part in self._parts((_CELLS, (f"import {module}",))):
            own = self._summary(part)
            places = {self._at(unit): self._digests[unit] for unit in own.reached if unit[0] in self._files}
            parts[self._fixed_name(part)] = {*map(self._fixed_name, own.parts)}, places
        return parts

    def _at(self, unit):
        return self._fixed_name(unit) or f"{unit[0]}:{unit[1]}"

    def _parts(self, root):
        """The units with a fixed name that `root` reaches, also through each other."""
        units = [root]
        for unit in units:
            units += [part for part in self._summary(unit).parts if part not in units]
        return units[1:]

    def _summary(self, root):
        """What `root` reaches without going beyond units with a fixed name, and the digests of that."""
        reached, seen, parts, numbers, looks = [root], {root}, {}, set(), set()
        for unit in reached:
            for other in self._unit(unit).edges:
                if self._fixed_name(other):
                    parts[other] = None
                elif other not in seen:
                    seen.add(other)
                    reached.append(other)
        self._digest_all(reached)
        for unit in reached:
            (text, targets, _), edges, is_shown = self._unit(unit), self._unit(unit).edges, is_look(unit[0])
            if unit == root or (unit[1] == RUN and (text or targets)):
                (looks if is_shown else numbers).add(self._digests[unit])
            if is_shown:
                numbers |= {self._digests[one] for one in edges if one in seen and not self._is_shown(one)}
            elif shown := [self._digests[one] for one in edges if is_look(one[0])]:
                looks.add(digest_of(shown))
        code = digest_of(sorted(numbers))
        return _Summary(self._accepted.get(code, code), digest_of(sorted(looks)), tuple(parts), reached)

    def _is_shown(self, unit):
        """Whether a unit counts for the looks of what only shows numbers: of other packages, all do."""
        return is_look(unit[0]) or unit[0] not in self._files

    def _digest_all(self, units):
        """Fill the digests of units, those before that others name; circles of them together."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        units = [unit for unit in units if unit not in self._digests]
        places = {unit: n for n, unit in enumerate(units)}
        named = {unit: [one for one in self._named_by(unit) if one in places] for unit in units}
        rows = [places[unit] for unit in units for _ in named[unit]]
        columns = [places[one] for unit in units for one in named[unit]]
        graph = coo_array(([1] * len(rows), (rows, columns)), shape=(len(units), len(units)))
        labels = dict(zip(units, connected_components(graph, connection="strong")[1].tolist(), strict=True))
        circles, after = defaultdict(list), defaultdict(set)
        for unit, label in labels.items():
            circles[label].append(unit)
            after[label] |= {labels[one] for one in named[unit]} - {label}
        for circle in map(circles.get, TopologicalSorter(after).static_order()):
            self._digests |= dict.fromkeys(circle, "circle")
            for _ in circle:  # after as many rounds as there are units each knows all of the circle
                self._digests |= {unit: self._digest(unit) for unit in circle}
            for unit in circle:
                if self._unit(unit).text:  # else it is another name, or nothing
                    own = self._digests[unit]
                    former = self._accepted.get(own, own)
                    # What another definition was, such as one number among several, is not what this was:
                    # it counts as itself, and those that name it count as what they were.
                    if own not in self._formers:
                        former = self._former.get(self._at(unit), former)
                    self._digests[unit] = former
                    self.accepts |= {own: former} if former != self._accepted.get(own, own) else {}

    def _named_by(self, unit):
        """The units by whose digests this one counts: of its kind, and without a fixed name."""
        named = [one for units, _ in self._unit(unit).targets for one in units if not self._fixed_name(one)]
        return [one for one in named if (self._is_shown(one) if is_look(unit[0]) else not is_look(one[0]))]

    def _digest(self, unit):
        text, targets, _ = self._unit(unit)
        known, pieces = set(self._named_by(unit)), []
        for units, attribute in targets:
            kinds = [one for one in units if is_look(unit[0]) or not is_look(one[0])]
            digests = [self._fixed_name(one) or (self._digests[one] if one in known else "") for one in kinds]
            pieces.append(f"{'|'.join(sorted(digests))}.{attribute or ''}")
        if unit[0] != _CELLS and unit[1] is None:
            pieces.sort()
        if not text and len(pieces) == 1 and pieces[0].endswith("."):
            return pieces[0][:-1]  # another name of that
        return digest_of([text, *pieces])

    def _unit(self, unit):
        module, name = unit
        if module == _CELLS:
            code, (text, holes) = parse_cells(name)
            return _Unit(text, self._targets(code, holes, None))
        if module not in self._files:
            return _Unit(f"{module}.{name or ''}")
        code, parts = self._read(module), module.split(".")
        before = [".".join(parts[:n]) for n in range(2, len(parts))] + [module]
        run = tuple((one, RUN) for one in before if one in self._files)
        if name == _FOLDER:
            inside = [one for one in self._files if one.startswith(f"{module}.")]
            units = [(one, defined) for one in inside for defined in self._read(one).index]
            return _Unit(_FOLDER, others=(*sorted(filter(self._fixed_name, units)), *run))
        if name is None:
            names = sorted(one for one in code.index if one not in code.ignored)
            public = [one if code.defines(one) and one[0] != "_" else "" for one in names]
            targets = [(((module, one),), shown) for one, shown in zip(names, public, strict=True)]
            return _Unit("module", tuple(targets), run)
        text, holes = code.part(name)
        return _Unit(text, self._targets(code, holes, module), run)

    def _fixed_name(self, unit):
        module, name = unit
        is_ours = name and name not in (RUN, _FOLDER) and module != _CELLS and module in self._files
        return self._read(module).fixed_name(name) if is_ours else None

    def _targets(self, code, holes, module):
        """What holes lead to: [(units, attribute of them that is used)]."""
        targets = []
        for hole in holes:
            units, rest = [] if hole.nodes else [(module, _FOLDER)], None
            for node in hole.nodes:
                named, is_attribute = [(module, hole.name)], False
                if isinstance(node, IMPORTS):
                    alias = next(one for one in node.names if bound_name(one) == hole.name)
                    *parent, place = code.source(node, alias)
                    is_bound = parent or alias.asname or "." not in place  # import a.b.c binds a
                    named = [(place, None)]
                    if parent and place not in self._files:
                        named = self._named(parent[0], alias.name)
                    elif hole.attribute and is_bound:
                        named, is_attribute = self._named(place, hole.attribute), True
                units += named
                rest = rest if is_attribute else hole.attribute
            targets.append((tuple(one for one in dict.fromkeys(units) if not is_ignored(one[0])), rest))
        return tuple(targets)

    def _named(self, module, name):
        """The units behind `name` of a module, which it makes or which a package offers."""
        if module not in self._files:
            return [(module, name)]
        code = self._read(module)
        units = [(module, name)] if name in code.index or (code.is_package and name == _FOLDER) else []
        if code.is_package and f"{module}.{name}" in self._files:
            units.append((f"{module}.{name}", None))
        if code.is_package and not units and "__getattr__" in code.index:
            units = self._offered(module, name) or [(module, "__getattr__")]
        return units or [(module, None)]

    def _offered(self, package, name):
        """The definitions of `name` in the modules of a package, and those that its sub-packages offer."""
        units = []
        for module in sorted(one for one in self._files if one.rpartition(".")[0] == package):
            code = self._read(module)
            if code.defines(name) or (code.is_package and name in code.index):
                units.append((module, name))
            elif code.is_package and "__getattr__" in code.index:
                units += self._offered(module, name)
        return units

    def _read(self, module):
        file = self._files[module]
        text = self.texts[file] if file in self.texts else file.read_text(encoding="utf-8")
        is_package = file.name == "__init__.py"
        package = module if is_package else module.rpartition(".")[0]
        return parse(text, package, is_package, is_look(module))
