"""Styles of the curves of figures to play with: those of the pictures, by the label of a curve."""

from himap.figures import styles

_TRUTH = {"color": "black", "linewidth": 1.8}
_OTHER = {"color": "0.45", "linestyle": (0, (3, 1, 1, 1))}


def methods(labels):
    """Methods by their names; thin and dotted of the full sky where there is a masked one too."""
    found = {label: _method(label) for label in labels}
    minima = [label for label in labels if label.startswith("minimum")]
    names = dict.fromkeys(filter(None, map(_name, labels)))  # a mark for each, in their order
    for label, name in zip(minima, names, strict=False):
        found[label] = {"color": _NAMES[name]["color"], "marker": "o", "linestyle": "none"}
    for label, line in (("$C_\\ell$ alone", (0, (5, 1.5))), ("$P(k_\\nu)$ alone", ":")):
        for one in labels:
            if one.endswith(label):
                found[one] = found[one] | {"linestyle": line, "linewidth": 1.1}
    return found


_NAMES = {style["label"]: style for style in styles.METHOD_STYLES.values()}


def _name(label):
    """The name of the method that a label begins with, or None."""
    return next((one for one in _NAMES if label == one or label.startswith((f"{one},", f"{one} "))), None)


def _method(label):
    name = _name(label)
    if name is None:
        return _TRUTH if label == "HI + noise" else _OTHER
    return _NAMES[name] | ({"linewidth": 0.8, "linestyle": (0, (1, 2))} if ", full sky" in label else {})


def sequence(labels):
    """Curves that have an order."""
    ordered = [label for label in labels if label != "HI + noise"]
    found = dict(zip(ordered, styles.sequence(ordered), strict=True))
    return {label: found.get(label, _TRUTH) for label in labels}


def corrected(labels):
    """Pairs of a spectrum that is not corrected, dotted, and the same corrected."""
    names = list(dict.fromkeys(label.rpartition(", ")[0] for label in labels if ", " in label))
    colours = dict(zip(names, (styles.INDIGO, *styles.COLOURS[1:]), strict=False))
    return {
        label: {
            "color": colours[label.rpartition(", ")[0]],
            "linestyle": ":" if label.endswith("uncorrected") else "-",
        }
        if ", " in label
        else _TRUTH
        for label in labels
    }


def apart(labels):
    """Curves without an order: colours and dashes that differ from each neighbour."""
    colours = (styles.BLUE, styles.VERMILION, styles.GREEN, styles.PURPLE)
    lines = ("-", "--", "-.", ":")
    return {
        label: {"color": colours[n % 4], "linestyle": lines[(n + n // 4) % 4]}
        for n, label in enumerate(labels)
    }
