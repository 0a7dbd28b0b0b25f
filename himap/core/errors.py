"""The only exception for bad input, and helpers for its message."""

from difflib import get_close_matches

_LONGEST = 4000  # characters of a message


class InputError(ValueError):
    """Input that himap cannot use.

    The message is one paragraph: what was expected, what was received, and a way out. The command line prints
    it without a traceback and exits with code 2. The received value may be anything: control characters are
    escaped, and very long values are shortened.
    """

    def __init__(self, message):
        super().__init__(shortened(plain_text(" ".join(str(message).splitlines()))))


def plain_text(text):
    """`text` with unprintable characters, such as control codes of a terminal, escaped."""
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode()
        for character in text
    )


def nearest(name, known):
    """Which of the `known` names was probably meant by `name`, for a message; empty if none is close."""
    close = get_close_matches(name, known, n=1)
    return f" (did you mean {close[0]}?)" if close else ""


def shortened(text):
    """`text` shortened to a few screens, including its end, which has the way out."""
    n_hidden, half = len(text) - _LONGEST, _LONGEST // 2
    return text if n_hidden <= 0 else f"{text[:half]} [... {n_hidden} characters more ...] {text[-half:]}"
