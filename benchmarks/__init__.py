"""Timed work, side by side with what a user would do without himap."""
