"""Files and command lines that are wrong in one way each, in one table, and good files to go with them."""

import gzip
import os
from functools import partial
from pathlib import Path

import h5py
import healpy as hp
import numpy as np
from astropy.io import fits
from cube_files import FREQ, SKY, STOKES, power_law_images, power_laws, write_container, write_image

NSIDE = 4
N_PIX = 12 * NSIDE**2
SHAPE = (24, N_PIX)
FREQS = np.linspace(950, 1065, 24)
SAID = {"unit": "mK", "order": "RING"}
EDGES = np.linspace(900, 1020, 25)


def good_maps():
    """`power_laws`, (24, 192)."""
    return power_laws(np.random.default_rng(20), FREQS, N_PIX)


def write_good():
    """In the current folder one good file of each kind."""
    maps = good_maps()
    write_hdf5("good.h5")
    np.save("good.npy", maps)
    np.savetxt("nu.txt", FREQS)
    np.save("nu.npy", FREQS)
    np.savetxt("widths.txt", np.full(24, 1.5))
    np.save("bl.npy", np.ones((24, 3 * NSIDE)))
    names = [f"{freq:g} MHz" for freq in FREQS]
    os.rename(write_cards(), "good.fits")
    part = np.where(np.arange(N_PIX) < 150, maps, hp.UNSEEN)
    write_fits("part.fits", part, partial=True, column_names=names)
    write_fits("mask.fits", np.ones(N_PIX), column_units=None)
    write_image("image.fits", power_law_images(np.random.default_rng(1)))


def write_hdf5(path, maps=None, freqs_name="freqs", freqs=FREQS, more=None, said=SAID, **attributes):
    """A cube in HDF5, with attributes of its maps and datasets `more`; gives its path."""
    with h5py.File(path, "w") as file:
        file.create_dataset("maps", data=good_maps() if maps is None else maps).attrs.update(attributes)
        if freqs_name is not None:
            file[freqs_name] = freqs
        for name, values in (more or {}).items():
            file[name] = values
        file.attrs.update(said)
    return path


def write_fits(path, maps, **options):
    hp.write_map(path, maps, **{"dtype": np.float32, "column_units": "mK", "overwrite": True} | options)


def write_cards(**cards):
    """a.fits, a good one with more cards."""
    names = [f"{freq:g} MHz" for freq in FREQS]
    write_fits("a.fits", good_maps(), column_names=names, extra_header=list(cards.items()))
    return "a.fits"


def write_folder(folder, names, headers=None):
    """A folder with a map for each name, and cards for each header."""
    os.mkdir(folder)
    for n, name in enumerate(names):
        cards = headers[n] if headers else ()
        write_fits(f"{folder}/{name}.fits", good_maps()[n], extra_header=cards)


def write_table(columns, **cards):
    """a.fits with these columns, a pixel a row."""
    table = fits.BinTableHDU.from_columns(columns)
    table.header.update({"PIXTYPE": "HEALPIX", "ORDERING": "RING", "NSIDE": NSIDE} | cards)
    table.writeto("a.fits")


def npy_with_header(path, header):
    """A .npy file with any text as its header."""
    text = header.encode("latin-1")
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    with open(path, "wb") as file:
        file.write(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(1000))


def change_cards(path, target, **cards):
    """A copy of a FITS file whose header says something else, without astropy's checks."""
    data = Path(path).read_bytes()
    for key, value in cards.items():
        place = data.rindex(key.ljust(8).encode() + b"=")
        data = data[:place] + f"{key:8}= {value:>20}".encode().ljust(80)[:80] + data[place + 80 :]
    Path(target).write_bytes(data)


def without(name):
    """a.h5, a good one but for one dataset, open for another in its place."""
    file = h5py.File(write_hdf5("a.h5"), "a")
    del file[name]
    return file


def with_unit_of_freqs(unit):
    with h5py.File(write_hdf5("a.h5"), "a") as file:
        file["freqs"].attrs["unit"] = unit


BAD = []
"""[(words of the command, a part of the message, function that writes what is wrong or None)]."""


def add(words, message, write=None, *given, **options):
    words = words.split() if isinstance(words, str) else words
    BAD.append((words, message, write and partial(write, *given, **options)))


# Frequencies in names and headers.
NO_FREQS = "does not state its frequencies"
for names in (["a_971p137MHz", "a_972p137MHz"], ["900-910MHz", "910-920MHz"], ["900MHz", "901MHz", "mean"]):
    add("folder", NO_FREQS, write_folder, "folder", names)
add("a.fits", NO_FREQS, write_fits, "a.fits", good_maps()[:2], column_names=["900 MHz of 20 MHz", "910 MHz"])
for names, values, message in (
    ("ab", ["900.0 MHz", 910.0], "FREQ in a header must be a number"),
    (["900MHz", "910MHz"], [900.0, 911.0], "names and headers"),
):
    cards = [[("FREQ", value)] for value in values]
    add("folder", message, write_folder, "folder", names, cards)
cards = [[("COORDSYS", frame)] for frame in "CG"]
add("folder", "one frame of coordinates, got C (900MHz.fits), G (910MHz.fits)", write_folder, "folder",
    ["900MHz", "910MHz"], cards)  # fmt: skip

# HDF5: what is a frequency, a unit, an order.
for name in ("freq_weights", "tsys_mhz", "nu_id"):
    add("a.h5", NO_FREQS, write_hdf5, "a.h5", freqs_name=name)
for said in ({"unit": "mK", "units": "K"}, {"unit": "mK", "order": "RING", "ordering": "NESTED"}):
    add("a.h5", "contradict each other", write_hdf5, "a.h5", said=said)
add("a.h5", "--freqs-name", write_hdf5, "a.h5", more={"nu": FREQS + 1})
add("a.h5", NO_FREQS, write_hdf5, "a.h5", freqs=np.arange(25.0))
for shape in ((N_PIX,), SHAPE[::-1]):
    add("a.h5", "has a mask", write_hdf5, "a.h5", more={"mask": np.zeros(shape, bool)})
for key, value in (("scale_factor", [1.0, 2.0]), ("scale_factor", np.inf), ("add_offset", "none")):
    add("a.h5", key, write_hdf5, "a.h5", **{key: value})
packed = {"_Unsigned": "true", "_FillValue": -1.0}
message = "_FillValue of maps in a.h5 must be an integer, as its maps with _Unsigned are"
add("a.h5", message, write_hdf5, "a.h5", good_maps().astype("i1"), **packed)
for value in (np.bytes_(b"\xff\xfe"), 7, ["mK", "K"], h5py.Empty("S1"), "K" * 20_000):
    add("a.h5", "unit", write_hdf5, "a.h5", said={"order": "RING"}, unit=value)
for value in (np.bytes_(b"R\xcfNG"), 1, "\x1b[31mRING"):
    add("a.h5", "RING or NESTED", write_hdf5, "a.h5", said={"unit": "mK"}, order=value)
for value in ("parsec", np.bytes_(b"\xb5Hz"), "(" * 5000):
    add("a.h5", "Hz", with_unit_of_freqs, value)
for values in (np.array([b"a"] * 24), np.ones(24, bool), FREQS.astype(complex)):
    add("a.h5", "freq", write_hdf5, "a.h5", freqs=values)
for message, more in (
    ("a.h5: all maps are zero", {"maps": np.zeros(SHAPE)}),
    ("got unit 'K km/s'. Convert the maps, and write them with their unit", {"said": {"unit": "K km/s"}}),
    ("frame of coordinates (an attribute of a.h5) must be one of G, C, E, ICRS, FK5, FK4", {"coordsys": 3}),
    ("FK5, FK4, FK4-NO-E, GAPPT, S, H, got 'sky'", {"frame": "sky"}),
    ("a.h5: SPECSYS must be one of TOPOCENT, GEOCENTR", {"specsys": 5}),
    ("states two pixel orders, RING and True", {"order": "RING", "nest": True}),
    ("RING or NESTED, got 'perhaps'", {"nested": "perhaps"}),
    ("a.h5 states nside 8, but maps has 4", {"nside": 2 * NSIDE}),
    ("contradict each other: BUNIT = 'K', unit = 'mK'", {"BUNIT": "K", "unit": "mK"}),
):
    add("a.h5", message, write_hdf5, "a.h5", **more)
for words in ("a.h5", "a.h5 --maps maps"):
    add(words, "complex numbers", write_hdf5, "a.h5", good_maps().astype(complex))
add("a.h5", "Name it with --maps", write_hdf5, "a.h5", more={"again": good_maps()})
add("a.h5", "\\x1b[2J", write_hdf5, "a.h5", more={"\x1b[2J\x07": good_maps()})
more = {f"{n}{'x' * 1000}": good_maps()[:2] for n in range(100)}
add("a.h5", "Name it with --maps", write_hdf5, "a.h5", more=more)
add("good.h5 --maps cubes", "has no dataset cubes")
add("good.h5 --freqs-name nus", "has no dataset nus")
SHAPED = "must be (n_channels, n_pix) with n_pix = 12 nside^2, but"
add("good.h5 --maps freqs", f"freqs {SHAPED} only 1 is: maps. Name it with --maps")
for words in ("a.h5", "a.h5 --maps maps"):
    message = f"{SHAPED} the file has freqs (24,); maps (24, 1, 192): write the maps in this shape to"
    add(words, message, write_hdf5, "a.h5", good_maps()[:, None])
for path in ("good.fits", "good.npy"):
    add(f"{path} --freqs nu.txt --unit mK --freqs-name x", "are for HDF5 files")


# HDF5: what leads elsewhere, or nowhere.
def elsewhere(name, values):
    Path("secret.txt").write_bytes(values.tobytes())
    with without(name) as file:
        where = [("secret.txt", 0, h5py.h5f.UNLIMITED)]
        file.create_dataset(name, values.shape, values.dtype, external=where)


def behind_a_link():
    with without("maps") as file:
        file["maps"] = h5py.ExternalLink("good.h5", "maps")


def virtual():
    layout = h5py.VirtualLayout(SHAPE, "f4")
    layout[...] = h5py.VirtualSource("good.h5", "maps", SHAPE)
    with without("maps") as file:
        file.create_virtual_dataset("maps", layout)


def deep_groups():
    with h5py.File("a.h5", "w") as file:
        group = file
        for _ in range(3000):
            group = group.create_group("g")
        group["maps"] = good_maps()


def many_groups():
    with h5py.File("a.h5", "w") as file:
        for n in range(10_001):
            file.create_group(f"{n}")


def large_hdf5():
    with without("maps") as file:
        file.create_dataset("maps", (24, 12 * 2**46), "f8", chunks=(1, 1024))


add("a.h5", "another file", elsewhere, "maps", good_maps())
add("a.h5", "another file", elsewhere, "freqs", FREQS)
add("a.h5 --maps maps", "another file", behind_a_link)
add("a.h5", "maps in another file", behind_a_link)
add("a.h5", "another file", virtual)
add("a.h5", "groups", deep_groups)
add("a.h5", "groups", many_groups)
add("a.h5", "GB", large_hdf5)

# Containers of cora and draco.
container = partial(write_container, "a.h5", good_maps(), FREQS)
for pols in (["XX", "YY"], ["I", "I"]):
    add("a.h5 --unit K", "contain I once", container, pols=pols)
add("a.h5 --unit K", "with the axes (freq, pol, pixel)", container, axis=("pol", "freq", "pixel"))
add("a.h5", "--unit", container)
for name, values, message in (
    ("index_map__freq", None, "no index_map/freq"),
    ("index_map__pol", None, "no index_map/pol"),
    ("index_map__pol", np.arange(4), "must contain I once"),
    ("index_map__pol", np.array([b"I"]), "1 names and"),
    ("index_map__freq", np.array([b"900"] * 24), "frequencies |S3 (24,)"),
    ("index_map__freq", np.zeros(24, dtype=[("width", "f8")]), "or a table with a column centre"),
    ("index_map__freq", h5py.ExternalLink("other.h5", "freqs"), "no index_map/freq in the same file"),
    ("mask", np.zeros(SHAPE, dtype=bool), "has a mask"),
    ("others", good_maps(), "2 are: others, map. Name it with --maps"),
):
    add("a.h5 --unit K", message, container, **{name: values})


# FITS tables.
def in_two_tables():
    pairs = zip(FREQS, good_maps(), strict=True)
    columns = [fits.Column(f"{freq:g} MHz", "E", "mK", array=one) for freq, one in pairs]
    tables = [fits.BinTableHDU.from_columns(part) for part in (columns[:12], columns[12:])]
    fits.HDUList([fits.PrimaryHDU(), *tables]).writeto("a.fits")


def part(pixels, n_maps=24):
    columns = [fits.Column("PIXEL", "J", array=np.asarray(pixels, dtype=np.int32))]
    ones = np.arange(1.0, 1 + len(pixels))
    columns += [fits.Column(f"{freq:g} MHz", "E", "mK", array=ones) for freq in FREQS[:n_maps]]
    write_table(columns, INDXSCHM="EXPLICIT", OBJECT="PARTIAL")


def columns_of(form):
    values = {"M": np.ones(N_PIX, complex), "4A": np.full(N_PIX, "word"), "8X": np.ones((N_PIX, 8), bool)}
    lists = np.array([np.ones(2, np.float32)] * N_PIX + [None], dtype=object)[:-1]
    write_table([fits.Column(f"{f:g} MHz", form, "mK", array=values.get(form, lists)) for f in FREQS[:3]])


def columns_of_two_lengths():
    parts = (("900 MHz", 64), ("910 MHz", 128))
    write_table([fits.Column(name, f"{n}E", "mK", array=np.ones((3, n), "f4")) for name, n in parts])


add("a.fits", "maps in 2 tables", in_two_tables)
for pixels in ([-1, 2, 3], [1, 2, N_PIX], [1, 2, 2]):
    add("a.fits", "pixel", part, pixels)
add("a.fits", "no column with a map", part, np.arange(5), 0)
for form in ("M", "4A", "8X", "PE()"):
    add("a.fits", "maps are real numbers", columns_of, form)
add("a.fits", "maps are real numbers, and the column 950 MHz", write_fits, "a.fits",
    np.ones((2, N_PIX), bool), dtype=bool, column_names=["950 MHz", "951 MHz"])  # fmt: skip
FRAMES = "COORDSYS in a.fits must be one of G, C, E, ICRS, FK5, FK4, FK4-NO-E, GAPPT, S, H, got"
SPECTRAL = "a.fits: SPECSYS must be one of TOPOCENT, GEOCENTR, BARYCENT, HELIOCEN, LSRK, LSRD, GALACTOC, "
for message, name, *values in (
    (f"{FRAMES} {{!r}}", "COORDSYS", 3, "3", True, "SKY"),
    (f"{SPECTRAL}LOCALGRP, CMBDIPOL, SOURCE, got {{!r}}", "SPECSYS", 5, "SKY"),
    ("ORDERING in a.fits must be RING or NESTED, got '{}'", "ORDERING", 0, False, "NUNIQ"),
    ("a.fits: it says NSIDE = {}, but", "NSIDE", "16", 0, 2.5),
    ("EQUINOX beside COORDSYS in a.fits must be a year, such as 2000, got {!r}", "EQUINOX", "soon", True),
):
    for value in values:
        add("a.fits", message.format(value), write_cards, **({"COORDSYS": "C"} | {name: value}))
add("a.fits", "must have one length", columns_of_two_lengths)
add("a.fits", "it says NSIDE = 8", change_cards, "good.fits", "a.fits", NSIDE=8)
units = {"column_units": ["mK", "K", "K"], "column_names": ["900 MHz", "910 MHz", "920 MHz"]}
one = {"column_units": "K km/s", "column_names": ["950 MHz", "960 MHz"]}
add("a.fits", "TUNIT of each column", write_fits, "a.fits", good_maps()[:2], **one)
add("a.fits", "one unit, got", write_fits, "a.fits", good_maps()[:3], **units)
for cards in ({"NAXIS2": 10**12}, {"NAXIS1": 10**15}, {"NSIDE": 2**26}, {"NAXIS2": -5}):
    source = "part.fits" if "NSIDE" in cards else "good.fits"
    add("a.fits", "a.fits", change_cards, source, "a.fits", **cards)
without_nside = fits.BinTableHDU.from_columns([fits.Column("950 MHz", "4E", "mK", array=np.ones((N_PIX, 4)))])
add("a.fits", "must say NSIDE", without_nside.writeto, "a.fits")  # for 192 pixels, or 768
add("a.fits", "nside a power of two; got 432 pixels", write_fits, "a.fits", np.ones((2, 12 * 6**2)))
for size, message in ((3000, "there is no table"), (15_000, "cannot be read as HEALPix")):
    add("a.fits", message, lambda n=size: Path("a.fits").write_bytes(Path("good.fits").read_bytes()[:n]))
add("a.fits", "Stokes parameters of one map", write_fits, "a.fits", good_maps()[:3])


# Images with world coordinates.
def write_two_images():
    """Data and their errors in one file."""
    write_image("b.fits", images, kind=fits.ImageHDU, EXTNAME="DATA")
    with fits.open("b.fits") as hdus:
        errors = fits.ImageHDU(np.ones_like(images), hdus[1].header, name="ERROR")
        fits.HDUList([*hdus, errors]).writeto("a.fits")


def write_image_folder(axes, **cards):
    os.mkdir("folder")
    write_image("folder/a.fits", images)
    write_image("folder/b.fits", images, axes=axes, **cards)


images = power_law_images(np.random.default_rng(1))
for message, cards in (
    ("u.brightness_temperature(freq, beam_area=...)", {"BUNIT": "Jy/beam"}),
    ("a.fits is in MJy/sr, and", {"BUNIT": "MJy/sr"}),
    ("give unit=", {"BUNIT": ""}),
    ("must be brightness temperatures", {"BUNIT": "m/s"}),
    ("got unit '3'", {"BUNIT": 3}),
    ("as BUNIT in a header, TUNIT", {"BUNIT": "K (Ta*)"}),
    ("FREQ also changes along axis 1", {"PC3_1": 0.1, "PC1_3": 0.0}),
    ("a.fits: RADESYS must be one of", {"RADESYS": 3}),
    ("a.fits: RADESYS must be one of", {"RADESYS": "SKY"}),
    ("a.fits: SPECSYS must be one of", {"SPECSYS": 7}),
):
    add("a.fits", message, write_image, "a.fits", images, **cards)
add("a.fits", "two sky axes", write_image, "a.fits", images,
    axes=(("X", 1, 1, 1, ""), ("Y", 1, 1, 1, ""), FREQ))  # fmt: skip
for message, *axis in (
    ("no frequency axis FREQ, but RA---SIN, DEC--SIN, LAYER", "LAYER", 1, 1, 1, ""),
    ("no frequency axis FREQ, but RA---SIN, DEC--SIN, VRAD", "VRAD", 1e5, 1, 1e3, "m/s"),
    ("but RA---SIN, DEC--SIN, VELO-LSR", "VELO-LSR", 1e5, 1, 1e3, "m/s"),
    ("probably in another unit", "FREQ", 1, 1, 1, "Hz"),
    ("a.fits: two channels have the same frequency", *FREQ[:3], 1.0, "Hz"),
    ("of an image are invalid", "FREQ-XYZ", *FREQ[1:]),
    ("of an image are invalid", "VELO", *FREQ[1:]),
    ("coordinates in a table", "FREQ-TAB", *FREQ[1:]),
):
    cards = {"RESTFRQ": 1.42e9} if "/s" in axis[-1] else {}
    add("a.fits", message, write_image, "a.fits", images, axes=(*SKY["SIN"], axis), **cards)
for given, words, message in (
    (np.stack([images] * 4), "", "4 values along STOKES"),
    (images[None, :1], "", "needs two observed channels"),
    (images[None], "--order RING", "an image has no HEALPix order"),
    (images[None], "--unit K", "the file states mK"),
):
    add(f"a.fits {words}", message, write_image, "a.fits", given, axes=(*SKY["SIN"], FREQ, STOKES))
for axes in (SKY["ZEA"], (*SKY["ZEA"], FREQ)):
    message = "in FITS order, so the axes cannot be identified. Write it with a header of three axes"
    add("a.fits --freqs nu.txt", message, write_image, "a.fits", images.T, axes=axes, WCSAXES=2)
for axes in ("ra,dec", "ra,ra,freq", "time,dec,freq", "pixel,freq", ","):
    add(f"image.fits --axes {axes}", "such as ra,dec,freq")
up = ("FREQ", 2e9, 1, 2e6, "Hz")
for message, axes, cards in (
    ("have the same channel, 980 MHz", (*SKY["SIN"], FREQ), {}),
    ("must have the same sky axes", (*SKY["CAR"], up), {}),
    ("must have one unit", (*SKY["SIN"], up), {"BUNIT": "K"}),
    ("has an axis FREQ; write it into the other header", (*SKY["SIN"], ("", 1, 1, 1, "")), {}),
):
    add("folder", message, write_image_folder, axes, **cards)
add("a.fits", "HDU 1 (DATA) and a.fits, HDU 2 (ERROR) have the same channel, 980 MHz", write_two_images)
add("image.fits --truth a.fits", "the truth must have the channels and the sky axes of the cube",
    write_image, "a.fits", images, axes=(*SKY["CAR"], FREQ))  # fmt: skip
add("a.fits", "two sky axes", lambda: fits.PrimaryHDU(np.ones((24, 10, 10))).writeto("a.fits"))
add("a.fits", "cannot be read as an image cube",
    lambda: Path("a.fits").write_bytes(Path("image.fits").read_bytes()[:9000]))  # fmt: skip


# Numbers in .npy and in text.
def save(name, values):
    np.save(name, values, allow_pickle=True)


READING = ["--freqs", "nu.txt", "--unit", "mK"]
NPY = ["a.npy", *READING]
npy = "{{'descr': '{}', 'fortran_order': False, 'shape': {}, }}".format
headers = [npy("<f8", f"(24, {10**15})"), npy("<f4", "(24.0, 192)"), npy("|O", "(24, 192)")]
for header in (*headers, "(" * 2000, "__import__('os').mkdir('owned')"):
    add(NPY, "a.npy", npy_with_header, "a.npy", header)
for array in (
    np.full(SHAPE, "a"),
    np.ones(SHAPE, bool),
    np.zeros(SHAPE, [("a", "f4")]),
    np.ones((24, 2, N_PIX)),
    np.float64(3),
    np.ones((24, 0)),
):
    add(NPY, "a.npy must hold numbers of shape (n_channels, n_pix) with n_pix = 12 nside^2", save, "a.npy",
        array)  # fmt: skip
add(NPY, "expected one frequency for each", save, "a.npy", np.ones((1, N_PIX)))
add(NPY, "needs two observed channels", save, "a.npy", np.full(SHAPE, np.nan))
add(NPY, "no .npy file of plain numbers", save, "a.npy", np.array([{"a": 1}], dtype=object))
add(NPY, "archive of arrays", lambda: (np.savez("a.npz", 1), os.rename("a.npz", "a.npy")))
for numbers, message in (
    (np.full(24, "a"), "b.npy"),
    (np.zeros(0), "b.npy"),
    (np.ones((24, 3, 3)), "b.npy"),
    (np.full(24, np.inf), "b.npy"),
    (np.full(24, 0.028), "FWHM in degrees, between"),  # rad
    (np.full(24, 96.0), "FWHM in degrees, between"),  # arcmin
    (np.column_stack([FREQS, np.full(24, 1.6)]), "for widths give one FWHM (deg) a line"),
    (7 * np.ones((24, 12)), "1 at l = 0"),
    (np.full((24, 12), np.nan), "finite b_l that are 1 at l = 0 and nowhere more, got nan"),
    (np.array([{"a": 1}]), "no .npy file of plain numbers"),  # code
    (1 + 0.1 * np.arange(12) * np.ones((24, 1)), "nowhere more"),
):
    add("good.h5 --beam b.npy", message, save, "b.npy", numbers)
COLUMNS = "one frequency per line"
for numbers, message in (
    (np.full(24, "a"), "f.npy"),
    (np.zeros(0, int), "f.npy"),
    (-FREQS, "freqs must be positive"),
    (FREQS[:3], "one frequency for each of the 24 channels, got 3"),
    (1e6 * FREQS, "looks like another unit"),
    (np.full(24, 1000.0), "two channels have the same frequency, or nearly, 1000 MHz"),
    (np.stack([FREQS, FREQS]), COLUMNS),
    (FREQS.reshape(2, 3, 4), "table of shape (2, 3, 4)"),
    (np.array([FREQS, np.full(24, 5.0)]).T, COLUMNS),
    (np.array([np.arange(1, 25), FREQS]).T, COLUMNS),
    (np.array([EDGES[:-1], EDGES[1:] - 0.1]).T, COLUMNS),
    (np.array([np.arange(24), EDGES[:-1], EDGES[1:]]).T, COLUMNS),
):
    add("good.npy --unit mK --freqs f.npy", message, save, "f.npy", numbers)
for content in (b"9\xe9\n", b"", b"1 2\n3\n"):
    for option, more in (("--freqs", "good.npy --unit mK"), ("--beam", "good.h5")):
        add(f"{more} {option} f.txt", "f.txt", Path("f.txt").write_bytes, 24 * content)
COMMAS = "has numbers with decimal commas"
for content, message in (
    (b"\nfreq_MHz\n950\n951", "must hold numbers alone, got 'freq_MHz' before them; put #"),
    ("950\n951".encode("utf-16"), "is no text in UTF-8"),
    (b"950.0 MHz\n951", "is no table of numbers"),
    (b"950,5\n951,0\n951,5\n", COMMAS),
    (b"1;950,5\n2;951,5", COMMAS),
    (b"950,5 0,1\n951,5 0,2", COMMAS),
    (b"1,50\n1,49", COMMAS),
):
    add("good.npy --unit mK --freqs f.txt", f"f.txt {message}", Path("f.txt").write_bytes, content)
add("good.h5 --beam b.npy", "b.npy", npy_with_header, "b.npy", npy("<f8", f"(24, {10**13})"))

# Masks, weights and flags.
for content in (b"no mask", b""):
    add("good.h5 --mask m.fits", "m.fits", Path("m.fits").write_bytes, content)
add("good.h5 --mask good.h5", "must be a .fits or .npy file")
add("good.h5 --mask away.fits", "away.fits")
spot = (np.arange(N_PIX) < 5).astype(np.float32)
for mask, message in (
    (np.ones(768), "one map of the pixels of the cube, (192,); got (1, 768)"),
    (0.5 * spot, "1 where kept and 0 elsewhere, such as mask > 0.5; 5 are not"),
    (0 * spot, "keeps no pixel"),
    (spot, "fewer than the 24 channels"),
):
    add("good.h5 --mask m.fits", message, write_fits, "m.fits", mask, column_units=None)
add("good.h5 --mask m.fits --method beam_subspace --beam evolving",
    "there are 1 modes to l = 8, and 24 channels need as many", write_fits, "m.fits", spot)  # fmt: skip
add("part.fits --mask m.fits", "no observed pixel of the cube", write_fits, "m.fits", spot[::-1])
add("image.fits --mask m.fits", "m.fits must have the sky axes of the cube", write_image, "m.fits",
    np.ones_like(images[0]), axes=SKY["CAR"], BUNIT="")  # fmt: skip
add("image.fits --mask m.npy", "m.npy must have the shape of an image", np.save, "m.npy",
    np.ones_like(images[0].T, bool))  # fmt: skip
add("good.h5 --mask m.npy", "m.npy must be one map", np.save, "m.npy", np.ones(SHAPE, bool))
add("image.fits --mask m.fits --rotate", "only HEALPix maps are rotated", write_image, "m.fits",
    np.ones_like(images[0]), axes=SKY["SIN"], BUNIT="")  # fmt: skip
add("good.h5 --mask m.fits", "ORDERING", change_cards, "mask.fits", "m.fits", ORDERING="''")
add("good.h5 --weights m.fits", "must state ORDERING", change_cards, "mask.fits", "m.fits", ORDERING="''")


def bad(value):
    out = np.ones(SHAPE)
    out.flat[5] = value
    return out


for word, values, message in (
    ("weights", bad(-1), "the weights w.npy must be finite and 0 or more; 0 means not observed; 1 are not"),
    ("weights", bad(np.inf), "finite and 0 or more"),
    ("flags", bad(2), "True (or 1) where a voxel is bad and False (or 0) where it is good; 1 are not"),
    ("flags", bad(np.nan), "1 are not"),
    ("weights", np.ones(768), "pixels of the cube, (192,), or of its voxels, (24, 192), including all"),
    ("weights", np.ones((23, N_PIX)), "including all channels of its file; got (23, 192)"),
    ("flags", np.ones((24, 24)), "must have the shape of one map, n_pix = 12 nside^2"),
    ("weights", np.zeros(N_PIX), "needs two observed channels, got 0 of 24"),
    ("weights", np.full(N_PIX, "a"), "must be real numbers"),
):
    add(f"good.h5 --{word} w.npy", message, save, "w.npy", values)
add("good.h5 --weights w.fits", "w.fits must be finite and 0 or more; 0 means not observed; 1 are not",
    write_fits, "w.fits", bad(np.inf)[0], column_units=None)  # fmt: skip
ones, blank = np.ones(SHAPE), np.ones_like(images)
descending = {"column_names": [f"{freq:g} MHz" for freq in FREQS[::-1]]}
for word in ("weights", "flags"):
    both = {f"{place}/{word}": np.arange(n) for n, place in enumerate("ab", 3)}
    for file, message, write in (
        ("there.npy", f"there is no file of {word}", None),
        ("good.h5", f"must have one dataset called {word}; it has", None),
        ("w.h5", f"it has a/{word}, b/{word}", partial(write_hdf5, "w.h5", more=both)),
        ("nu.txt", "must be a .h5, .fits or .npy file", None),
        ("w.npy", "is no .npy file", partial(npy_with_header, "w.npy", "")),
        ("w.fits", "must have the channels of the cube", partial(write_fits, "w.fits", ones, **descending)),
    ):
        add(f"good.h5 --{word} {file}", message, write)
    alike = "must have the sky axes of the cube"
    for file, message, write in (
        ("w.fits", alike, partial(write_image, "w.fits", blank[0].T, axes=SKY["SIN"])),
        ("nu.txt", "of a cube of images must be a .fits or .npy file", None),
        ("w.npy", "the shape of an image of the cube, (12, 16)", partial(save, "w.npy", blank[0].T)),
        ("w.npy", "must be of the pixels of the cube", partial(save, "w.npy", blank[:3])),
    ):
        add(f"image.fits --{word} {file}", message, write)


# Truths, outputs, names of files and other words of commands.
add("good.h5 --truth good.h5", "the truth is the cube itself")
add(["good.h5", "--truth", "good.npy", *READING], "the truth is the cube itself")
add("good.h5 --truth a.h5", "got 953 MHz where that has 950", write_hdf5, "a.h5", freqs=FREQS + 3)
add("good.h5 --truth a.h5", "the truth must have the channels", write_hdf5, "a.h5", np.tile(good_maps(), 4))


add("suggest good.h5 -o f.html", "give --overwrite", Path("f.html").touch)
add("suggest good.h5 --flags f.html -o f.html --overwrite", "is an input", Path("f.html").touch)
for command, output in (("clean", "nu.h5"), ("suggest", "nu.html"), ("transfer", "nu.html")):
    words = f"{command} good.npy --freqs nu.html --unit mK --method beam_subspace --beam evolving -o {output}"
    add(f"{words} --overwrite", "is an input", os.rename, "nu.txt", "nu.html")
for words, *names in (
    ("good.npy --unit mK --freqs c_mixing.txt -o c.npy", "nu.txt", "c_mixing.txt"),
    ("c_foreground.npy --unit mK --freqs nu.txt -o c.npy", "good.npy", "c_foreground.npy"),
):
    add(f"{words} --overwrite", "is an input", os.rename, *names)
for words in (
    "--mask mask.fits -o mask.fits",
    "--weights bl.npy -o bl.npy",
    "--method gnilc -p prior=good.npy -o good.npy",
    "-o good.h5",
    "--truth good.npy -o good.npy",
):
    add(f"good.h5 {words} --overwrite", "is an input")
add(
    ["link.npy", *READING, "-o", "good.npy", "--overwrite"], "is an input", os.symlink, "good.npy", "link.npy"
)
add("good.h5 -o good.fits", "give --overwrite")
add("good.h5 -o c.txt", "the output must be a .h5, .hdf5, .fits, .fits.gz or .npy file, got c.txt")
for name in ("nowhere/c.h5", "c.hdf", "", "..", "c\0.h5"):
    add(["good.h5", "-o", name], "")
add("good.h5 -o p.h5 --overwrite", "p.html is a folder", os.mkdir, "p.html")
add("good.h5 -o p.h5 --overwrite", "p.h5 is a folder; give the name", os.mkdir, "p.h5")
add("good.h5 -o p.h5 --overwrite", "p.h5 is no ordinary file", os.mkfifo, "p.h5")
for option in ("", "--beam", "--truth", "-o"):
    message = "cannot be written (File name too long)" if option == "-o" else "xxx"
    add(f"{'good.h5 ' * bool(option)}{option} {'x' * 300}.h5", message)
for option in ("", "--freqs", "--mocks"):
    add(f"{'good.h5 ' * bool(option)}{option} loop.h5", "loop.h5", os.symlink, "loop.h5", "loop.h5")
for words in ("", "good.h5 --beam ", "good.h5 --mask ", "good.h5 --method gnilc -p prior="):
    add(f"{words}pipe.fits", "pipe.fits", os.mkfifo, "pipe.fits")
add("good.h5 --mask folder", "folder", os.mkdir, "folder")
add("folder", "contains no FITS file", os.mkdir, "folder")
for message, write in (
    ("920MHz.fits", os.mkfifo),
    ("920MHz.fits", os.mkdir),
    ("one order of pixels, got", partial(write_fits, maps=good_maps()[1], nest=True)),
    ("one map", partial(write_fits, maps=good_maps()[:3], column_names=["I", "Q", "weights"])),
):
    add("folder", message, lambda write=write: (
        write_folder("folder", ["900MHz", "910MHz"]), write("folder/920MHz.fits")))  # fmt: skip
for name in ("a.h5", "a.fits", "a.npy", "a.txt"):
    for content in ("", "no cube"):
        words = [name, *(READING if name == "a.npy" else [])]
        message = "a cube is HDF5, FITS or .npy" if name == "a.txt" else name
        add(words, message, lambda name=name, content=content: Path(name).write_text(content))
add("a.h5.gz", "match none of them (unpack archives",
    lambda: Path("a.h5.gz").write_bytes(gzip.compress(Path("good.h5").read_bytes())))  # fmt: skip
add([""], "there is no file ''")
add("nothing.h5", "there is no file")
add("good.npy --freqs nu.txt", "K or mK")
add("good.npy --freqs nu.txt --unit Jy", "brightness temperatures")
add("good.npy --unit mK", NO_FREQS)
add("good.h5 --order SPIRAL", "RING or NESTED")
add("good.h5 --order NESTED", "the file states RING, but the order")
add("good.h5 --unit K", "the file states mK, but the unit given is K")
add("good.h5 --frame X", "frame of coordinates (--frame) must be one of G, C, E, ICRS")
add("a.h5 --frame G", "the file states C, but the frame given is G", write_hdf5, "a.h5", coordsys="C")
add("good.h5 --freqs widths.txt", "but the list of frequencies")

BEAM = "--method beam_subspace --beam"
add("good.h5 --method magic", "unknown method")
add("good.h5 -p n_sorces=3", "did you mean n_sources")
add("good.h5 -p n_sources=2 -p N_SOURCES=3", "n_sources is given twice")
add("good.h5 -p contrast=\udcff --method fastica", "contrast must be text in UTF-8")
add("good.h5 --flags bl.npy --method fastica", "fastica takes no weights")
for write, message in (
    (None, "there is no file"),
    (partial(Path("p.npy").write_bytes, b"words"), "is no .npy file of plain numbers"),
    (partial(np.save, "p.npy", np.zeros((3, 12))), "the shape of the maps, (24, 192), got (3, 12)"),
    (partial(np.save, "p.npy", np.full(SHAPE, np.nan)), "the mock of prior must be finite everywhere"),
):
    add("good.h5 --method gnilc -p prior=p.npy", message, write)
for scale in (1e-3, 1e3):  # in K and in uK; the noise is 1 mK
    noise = scale * np.random.default_rng(3).standard_normal(SHAPE)
    add(f"good.h5 --method gnilc -p prior=p{scale:g}.npy", "times its power: see its unit", np.save,
        f"p{scale:g}.npy", noise)  # fmt: skip
add("good.h5 -p name=x", "name")
for value in ("0", "many", "1e999"):
    add(f"good.h5 -p n_sources={value}", "n_sources")
add("good.h5 -p n_sources=30", "at most the number of channels")
add("good.h5 --method sdecgmca --beam evolving", "-p noise=0.04")
add("good.h5 --restarts 8", "leave restarts out")
add("good.h5 --method sdecgmca --beam evolving --restarts 0", "restarts must be")
add("good.h5 --method beam_subspace", "give --beam")
add(f"good.h5 {BEAM} square", "unknown beam")
add(f"good.h5 {BEAM} file", "the path of the file itself")
add(f"good.h5 {BEAM} b.npy", "got (3,)", save, "b.npy", np.ones(3))
add("good.h5 --beam evolving --dish 0", "diameter in m")
add("good.h5 --dish 3", "dish")
for word in ("1000000000000", "0", "-3"):
    message = f"the number of mocks must be a whole number between 1 and 10000, got {word}"
    add(f"transfer good.h5 --beam evolving --mocks {word}", message)
for words, message in (
    ("--mocks 2", "give it (beams=, --beam), or your own mocks"),
    ("--mocks 2 --mocks part.fits", "one number, or a file per mock"),
    ("--mocks none.h5", "there is no file 'none.h5'"),
    ("--mocks good.h5 --mock-noise 1", "those from files include noise"),
    ("--beam evolving --mocks 2 --mock-noise 0", "noise must be above zero"),
):
    add(f"transfer good.h5 {words}", message)
message = "a.h5: a mock must have the channels and the nside of the cube"
add("transfer good.h5 --mocks a.h5", message, write_hdf5, "a.h5", np.tile(good_maps(), 4))
add("good.h5 --mock-noise 1", "applies to a number")
for name in ("gnilc", "sdecgmca", "beam_subspace", "smooth_spectra"):
    message = f"{name} uses multipoles of the sphere, and the cube is an image in the plane: use "
    message += "fastica, gaussian_process, gmca, parametric, pca or polynomial"
    add(f"image.fits --method {name} --beam evolving", message)
for words in ("--beam evolving", "--mocks image.fits", "--mocks 2"):
    add(f"image.fits {words}", "the cube is an image in the plane")
for words in (f"--to {10**30}", "--from 24 --to 25"):
    add(f"suggest good.h5 --keep-peaks {words}", "sources")
add("suggest good.h5 -p n_sources=3", "--from and --to")
add("suggest good.h5 --method polynomial", "has no number of sources")
add("suggest good.h5 --flags bl.npy --method gmca", "takes no weights")
message = "--period applies to oscillating errors: give --ripple too"
add("sensitivity good.h5 --method beam_subspace --beam evolving --width 0.01 --period 7", message)
for command in ("suggest", "sensitivity", "transfer"):
    add(f"{command} good.h5 -o n.png", "the page must be a .html file")

# Records and notebooks, before any work.
for words, message in (
    (f"claims -p n_sources_max={10**12}", "n_sources_max must be a whole number"),
    (f"readings -p n_sources_max={10**12}", "n_sources_max must be a whole number"),
    ("clams", "unknown experiment 'clams'; there are authors, beam_errors"),
    ("claims -p n_realisation=2", "did you mean n_realisations"),
    ("claims -p galaxy=templates", "needs template_dir"),
    ("claims -o claims.txt", "must be a file name ending in .json"),
    ("claims --preset huge", "unknown preset"),
    ("claims --jobs 0", "--jobs"),
    ("claims --check none.json", "there is no record none.json"),
    ("claims --check none.json --grow none.json", "give one of them"),
    ("claims --check none.json -o b.json", "without -o and"),
    ("claims --grow none.json --overwrite", "without -o and"),
    ("transfer -p n_mock=2", "did you mean n_mocks"),
):
    add(f"measure {words}", message)
unknown = dict.fromkeys(("readings", "restarts", "flags"), "average=ratios polynomial=logarithm")
unknown["readings"] += " reading=code method=beam_subspace"
unknown |= {"transfer": "results=[]", "beam_errors": "results=[]", "methods": "results=null"}
for name, pairs in unknown.items():
    for pair in pairs.split():
        add(f"measure {name} -p {pair}", f"unknown parameter {pair.partition('=')[0]}")
for words, message in (
    ("04_pca -p n_sorces=3", "did you mean n_sources"),
    ("04_pca -p n_sources", "-p name=value; got -p n_sources"),
    ("04_pca -p n_sources=1 -p n_sources=2", "given twice"),
    ("04_pca --preset ci -p preset=quick", "given twice, as ci and as quick"),
    ("04_pca --preset big", "unknown preset 'big'"),
    ("04_pca 99_none", "no notebook '99_none'"),
    ("04_pca 05_fastica -o out.ipynb", "-o names the output of one notebook"),
    ("--stale -p n_sources=3", "--stale runs notebooks as they are committed"),
    ("--stale -o .", "--stale runs notebooks as they are committed"),
    ("--all 04_pca", "--all runs every notebook; omit it to run only 04_pca"),
    ("--all -p n_sorces=3", "no notebook has the parameter n_sorces"),
    (f"04_pca --max-memory {'9' * 5000}", "such as 16GB, and at most 1000 TB; got '9999"),
    (f"04_pca -p n_sources={'x' * 100_000}", "characters more ...]"),
    ("", "name the notebooks to run"),
):
    add(f"run {words}", message)
