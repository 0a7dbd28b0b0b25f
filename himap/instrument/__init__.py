"""The instrument: beams, noise, and the observation of a sky."""
