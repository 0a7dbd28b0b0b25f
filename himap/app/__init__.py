"""The notebooks: their location, dependencies and execution."""
