"""The instrument: beams, noise, and the observation they make of a sky."""
