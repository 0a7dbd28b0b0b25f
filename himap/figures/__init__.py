"""Presentation of results: figures, their numbers, tables."""
