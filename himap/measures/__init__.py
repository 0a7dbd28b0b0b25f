"""What is measured on a cleaned cube; the only rooms that know the truth."""
