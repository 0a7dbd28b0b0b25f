"""Made once, kept, shared among processes; this knows no physics."""
