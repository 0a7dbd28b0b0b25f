"""How anything is shown: figures, their numbers, tables."""
