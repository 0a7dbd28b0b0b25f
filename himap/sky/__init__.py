"""The simulated sky: HI, Galaxy and point sources."""
