"""Fingerprints of code: which result depends on which lines.

A fingerprint is a digest of the text of code (`himap.store.syntax`: only what can change a number) and of all
names used in it: definitions of the same module, imports from others, and names offered by a package. A
definition is represented by its text and by the digests of the names it uses, in their order, not by its own
name or location: renaming or moving it changes nothing. Definitions that refer to each other cyclically get
digests that depend on the whole cycle. Code that runs on import, of each module involved and of the packages
that contain it, counts too, and so do imports of a package that are neither used there nor offered in
``__all__``, as they are there for their side effects (such as a registration).

Products, and classes with a fixed ``name`` such as methods and beams, have separate digests, and are
represented elsewhere by that name. The fingerprint of a notebook or a record is therefore a dict: "code",
"look", and the digest of every product and named class that it uses, by name. Code that uses ``__path__``, to
list the folder of a package, depends on all named classes there; one that is added later was not used, and
`moved` compares only the stored names.

Code that only displays numbers (`himap.store.sources.LOOKS`) counts in "look", other code used by it in
"code". Other packages count by name: a new numpy makes nothing stale. Code that gives the numbers of former
code (`himap.store.verify`) counts as that. Only source is read: nothing is imported.
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
"""In a checkout: {digest of a definition, or of all behind a product: one with the same numbers}."""

PROBES = ACCEPTED.with_name("probes.json")
"""Reference numbers for changed code (`himap.store.verify`)."""

_FOLDER, _CELLS = "__path__", "<cells>"


def stored_dict(path):
    """Content of `ACCEPTED` or `PROBES`; empty without a checkout."""
    try:
        return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    except ValueError as error:
        raise InputError(
            f"{path} is not JSON ({error}), perhaps after a merge: restore it with `git checkout`, and run "
            "`himap verify`."
        ) from None


def accepted_version():
    """A value that changes with `ACCEPTED`."""
    return ACCEPTED, ACCEPTED.stat().st_mtime_ns if ACCEPTED.is_file() else None


def moved(stored, today, *, looks=False):
    """Names under which a stored fingerprint differs from today's: empty if results from it are fresh.

    Both are {"code", "look", name of a product or class, path of a file from "./": digest}. A name only in
    `today`, for example of a new method, is ignored, except for files. An outdated stored format, not a dict,
    cannot be compared. Appearance counts only with `looks`.
    """
    if not (isinstance(stored, dict) and isinstance(today, dict)):
        return ["code"]
    names = [*stored, *(name for name in today if name.startswith("./") and name not in stored)]
    return [name for name in names if (looks or name != "look") and stored.get(name) != today.get(name)]


class _Unit(NamedTuple):
    """Content of (module, name): digest of its text; the targets of its holes, [(units, attribute)]; and
    other units that count because of what they do on import."""

    text: str
    targets: tuple = ()
    others: tuple = ()

    @property
    def edges(self):
        return [*(unit for units, _ in self.targets for unit in units), *self.others]


_Summary = namedtuple("_Summary", "code look parts reached")


class CodeTree:
    """The source of one or more packages, as a dependency graph.

    Parameters
    ----------
    texts
        {path of a file: text} that replaces the file on disk, such as `himap.store.sources.LOADED`.
    accepted
        {digest of a definition: the equivalent digest}; default: those in `ACCEPTED`.
    former
        {place of a definition (see `parts_of`): equivalent former digest}; the resulting equivalences are
        in the attribute `accepts`, a dict like `accepted`.
    formers
        All former digests, none of which is accepted for another; default: those of `former`.
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
        """The same for pieces of code, such as the cells of a notebook, including their imports."""
        root, codes = (_CELLS, sources), defaultdict(list)
        for part in self._parts(root):
            codes[self._fixed_name(part)].append(self._summary(part).code)
        named = {name: one[0] if len(one) == 1 else digest_of(sorted(one)) for name, one in codes.items()}
        code, look, *_ = self._summary(root)
        return {"code": code, "look": look} | dict(sorted(named.items()))

    def parts_of(self, module):
        """{fixed name: (those used by its code, {place: digest} of the definitions behind it)}.

        For every product and named class of a module. The place is ``module:name``, or the fixed name.
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
        """The units with a fixed name used by `root`, directly or through each other."""
        units = [root]
        for unit in units:
            units += [part for part in self._summary(unit).parts if part not in units]
        return units[1:]

    def _summary(self, root):
        """Units used by `root` up to those with a fixed name, and their digests."""
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
        """Whether a unit counts for the appearance of display code: all units of other packages do."""
        return is_look(unit[0]) or unit[0] not in self._files

    def _digest_all(self, units):
        """Compute the digests of units after those of the units they use; cycles together."""
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
            for _ in circle:  # as many rounds as units, so that each depends on all others
                self._digests |= {unit: self._digest(unit) for unit in circle}
            for unit in circle:
                if self._unit(unit).text:  # else an alias, or nothing
                    own = self._digests[unit]
                    former = self._accepted.get(own, own)
                    # The former digest of another definition, such as one number among several, is not that
                    # of this one: it counts as itself, and its users count as their former code.
                    if own not in self._formers:
                        former = self._former.get(self._at(unit), former)
                    self._digests[unit] = former
                    self.accepts |= {own: former} if former != self._accepted.get(own, own) else {}

    def _named_by(self, unit):
        """The units whose digests enter that of this one: of the same kind, and without a fixed name."""
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
            return pieces[0][:-1]  # an alias
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
        """Targets of holes: [(units, attribute of them that is used)]."""
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
        """The units behind `name` of a module, defined there or offered by a package."""
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
        """Definitions of `name` in the modules of a package, and those offered by its sub-packages."""
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
