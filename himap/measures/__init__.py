"""Measurements on a cleaned cube; only these modules know the truth."""
