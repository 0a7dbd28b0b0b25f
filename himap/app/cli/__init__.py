"""The `himap` command."""
