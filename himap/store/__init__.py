"""Results computed once, stored, and shared between processes; independent of physics."""
