"""`python -m himap` is the `himap` command, and this is where both begin.

The imports take a while too, in which somebody may change their mind.
"""

import faulthandler
import sys

__all__ = ["start"]


def start():
    """Run the command; an interruption ends it in one word, at any time, and a crash names its signal."""
    try:
        if sys.__stderr__ is not None:
            faulthandler.enable(sys.__stderr__)
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):  # a terminal may lack a character of a table
                stream.reconfigure(errors="backslashreplace")
        from himap.app.cli.main import main

        main(prog_name="himap")
    except KeyboardInterrupt:
        print("\nAborted!", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    start()
