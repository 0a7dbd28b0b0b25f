"""`python -m himap` is the `himap` command, and this is where both begin.

The imports take a while too, in which somebody may change their mind.
"""

import sys

__all__ = ["start"]


def start():
    """Run the command; an interruption ends it in one word, whenever it comes."""
    try:
        from himap.app.cli.main import main

        main(prog_name="himap")
    except KeyboardInterrupt:
        print("\nAborted!", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    start()
