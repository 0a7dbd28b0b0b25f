"""The one exception that bad input raises, and words for its message."""

from difflib import get_close_matches

_LONGEST = 4000  # characters of a message


class InputError(ValueError):
    """Input that himap cannot use.

    The message is one paragraph: what was expected, what came, and the way out. The command
    line prints it without a traceback and exits with code 2. What came may be anything: control characters
    are written out, and what is too long to be read is shortened.
    """

    def __init__(self, message):
        super().__init__(shortened(plain_text(" ".join(str(message).splitlines()))))


def plain_text(text):
    """`text` with whatever is not printable, such as codes that steer a terminal, written out."""
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode()
        for character in text
    )


def nearest(name, known):
    """Which of some `known` names is probably meant by `name`, for a message; empty where none is close."""
    close = get_close_matches(name, known, n=1)
    return f" (did you mean {close[0]}?)" if close else ""


def shortened(text):
    """`text` that fits a few screens, with its end, where the way out is."""
    n_hidden, half = len(text) - _LONGEST, _LONGEST // 2
    return text if n_hidden <= 0 else f"{text[:half]} [... {n_hidden} characters more ...] {text[-half:]}"
