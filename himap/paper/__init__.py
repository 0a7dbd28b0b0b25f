"""The paper: its methods and beams, its chain from sky to spectra, and its claims."""
