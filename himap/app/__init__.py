"""The notebooks: where they are, what they depend on, how they are run."""
