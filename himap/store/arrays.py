"""Results on disk as arrays and JSON: memory-mapped, in an open format, and without executable pickles.

A folder has ``value.json``, the tree of the result, and each of its arrays as a ``.npy`` file. A dataclass is
stored as the name of its class and its fields; on reading, the class is looked up among the loaded modules
and instantiated from its fields; nothing is imported.
"""

import json
import re
import sys
from dataclasses import fields, is_dataclass

import numpy as np

from himap.core.errors import InputError

TREE = "value.json"
_KINDS = "biufc"  # of arrays: numbers and bools
_MAPPED = 2**20  # bytes: mapped files stay open, so thousands of small ones would be too many
_ARRAY, _CLASS, _TUPLE, _DICT = "array", "class", "tuple", "dict"


def write_value(value, folder):
    """Write a result into a folder, a `Path`; returns the names of the files.

    InputError for anything but arrays of numbers, dataclasses, lists, tuples, dicts, text and numbers.
    """
    arrays = []
    tree = _tree_of(value, arrays)
    names = [f"{n}.npy" for n in range(len(arrays))]
    for name, array in zip(names, arrays, strict=True):
        np.save(folder / name, array, allow_pickle=False)
    (folder / TREE).write_text(json.dumps(tree, indent=1))
    return [TREE, *names]


def read_value(folder):
    """Read a result of `write_value`, with read-only arrays, large ones memory-mapped; else ValueError."""
    return _value_of(json.loads((folder / TREE).read_text()), folder)


def _tree_of(value, arrays):
    """The tree of a value; its arrays are appended to `arrays`."""
    if type(value) in (np.ndarray, np.memmap) and value.dtype.kind in _KINDS:
        arrays.append(value)
        return {_ARRAY: f"{len(arrays) - 1}.npy"}
    if isinstance(value, np.generic):
        value = value.item()
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind is list:
        return [_tree_of(item, arrays) for item in value]
    if kind is tuple:
        return {_TUPLE: [_tree_of(item, arrays) for item in value]}
    if kind is dict:
        # Pairs, since keys of JSON are text.
        return {_DICT: [[_tree_of(part, arrays) for part in pair] for pair in value.items()]}
    if _class_of(kind.__module__, kind.__qualname__) is kind:
        own = {item.name: _tree_of(getattr(value, item.name), arrays) for item in fields(value)}
        return {_CLASS: [kind.__module__, kind.__qualname__], "fields": own}
    name = f"{kind.__name__}{f' of {value.dtype}' if isinstance(value, np.ndarray) else ''}"
    raise InputError(
        "the result of a product must be an array of numbers, or a dataclass of a module, list, tuple or "
        f"dict of these, of text and of real numbers, got {name}."
    )


def _value_of(tree, folder):
    if isinstance(tree, list):
        return [_value_of(item, folder) for item in tree]
    if not isinstance(tree, dict):
        return tree
    if _ARRAY in tree:
        if not re.fullmatch(r"\d+\.npy", tree[_ARRAY]):
            raise ValueError(f"{tree[_ARRAY]} is not an array of this folder")
        path = folder / tree[_ARRAY]
        mode = "r" if path.stat().st_size > _MAPPED else None
        array = np.load(path, mmap_mode=mode, allow_pickle=False)
        array.flags.writeable = False
        return array
    if _TUPLE in tree:
        return tuple(_value_of(tree[_TUPLE], folder))
    if _DICT in tree:
        return dict(_value_of(pair, folder) for pair in tree[_DICT])
    kind = _class_of(*tree[_CLASS])
    if kind is None:
        raise ValueError(f"the class {'.'.join(tree[_CLASS])} no longer exists")
    return kind(**{name: _value_of(item, folder) for name, item in tree["fields"].items()})


def _class_of(module, name):
    """The dataclass of that name, if its module is loaded and it can be made from its fields; else None."""
    kind = getattr(sys.modules.get(module), name, None)
    is_known = isinstance(kind, type) and is_dataclass(kind) and all(item.init for item in fields(kind))
    return kind if is_known else None
