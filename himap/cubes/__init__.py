"""Users' cubes: read, cleaned by any of the methods, assessed, and written in the layout of the input."""

from himap.cubes.cleaning import beams_of, clean_cube
from himap.cubes.corrected import correct
from himap.cubes.files import read_cube
from himap.cubes.report import write_report
from himap.cubes.sensitivity import beam_sensitivity
from himap.cubes.suggestion import suggest
from himap.cubes.transfer import measure_transfer
from himap.cubes.writing import save_cleaned

__all__ = [
    "beam_sensitivity",
    "beams_of",
    "clean_cube",
    "correct",
    "measure_transfer",
    "read_cube",
    "save_cleaned",
    "suggest",
    "write_report",
]
