"""`python -m himap` is the `himap` command."""

from himap.cli.main import main

if __name__ == "__main__":
    main(prog_name="himap")
