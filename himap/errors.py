"""The one exception that bad input raises."""

__all__ = ["InputError"]


class InputError(ValueError):
    """Input that himap cannot use.

    The message is one paragraph: what was expected, what came, and the way out. The command
    line prints it without a traceback and exits with code 2.
    """
