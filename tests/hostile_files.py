"""Files and command lines that are wrong in one way each, as a hostile tester found them."""

import os
from pathlib import Path

import h5py
import healpy as hp
import numpy as np
from astropy.io import fits

NSIDE = 4
N_PIX = 12 * NSIDE**2
FREQS = np.linspace(950, 1065, 24)
SAID = {"unit": "mK", "order": "RING"}
READING = ["--freqs", "nu.txt", "--unit", "mK"]


def good_maps():
    """Two power laws and noise, mK, (24, 192) float32."""
    rng = np.random.default_rng(20)
    spectra = (FREQS / 1000)[:, None] ** np.array([-2.1, -2.8])
    bright = spectra @ (1e3 * np.exp(rng.standard_normal((2, N_PIX))))
    return (bright + rng.standard_normal((24, N_PIX))).astype(np.float32)


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
    write_fits("good.fits", maps, column_names=names)
    write_fits(
        "part.fits", np.where(np.arange(N_PIX) < 150, maps, hp.UNSEEN), partial=True, column_names=names
    )
    write_fits("mask.fits", np.ones(N_PIX), column_units=None)


def write_hdf5(path, maps=None, freqs_name="freqs", freqs=FREQS, more=None, said=SAID, **attributes):
    """A cube in HDF5, with attributes of its maps and datasets `more`; a file that is open, for changes."""
    with h5py.File(path, "w") as file:
        file.create_dataset("maps", data=good_maps() if maps is None else maps).attrs.update(attributes)
        if freqs_name is not None:
            file[freqs_name] = freqs
        for name, values in (more or {}).items():
            file[name] = values
        file.attrs.update(said)


def write_fits(path, maps, **options):
    hp.write_map(path, maps, **{"dtype": np.float32, "column_units": "mK", "overwrite": True} | options)


def write_folder(folder, names, headers=None):
    """A folder with a map for each name, and cards for each header."""
    os.mkdir(folder)
    for n, name in enumerate(names):
        cards = headers[n] if headers else ()
        write_fits(f"{folder}/{name}.fits", good_maps()[n], extra_header=cards)


def npy_with_header(path, header):
    """A .npy file with any text as its header."""
    text = header.encode("latin-1")
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    with open(path, "wb") as file:
        file.write(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(1000))


def change_cards(path, target, hdu=1, **cards):
    """A copy of a FITS file whose header says something else, without astropy's checks."""
    data = Path(path).read_bytes()
    for key, value in cards.items():
        place = data.rindex(key.ljust(8).encode() + b"=") if hdu else data.index(key.ljust(8).encode() + b"=")
        data = data[:place] + f"{key:8}= {value:>20}".encode().ljust(80)[:80] + data[place + 80 :]
    with open(target, "wb") as file:
        file.write(data)


BY_HAND = {}
"""{what is wrong: function that writes it, and returns (words of the command, a part of the message)}."""


def case(function):
    BY_HAND[function.__name__.replace("_", " ")] = function
    return function


def cases(**named):
    def with_all(function):
        for name, argument in named.items():
            BY_HAND[f"{function.__name__} {name}".replace("_", " ")] = lambda a=argument: function(a)
        return function

    return with_all


NAMES = {
    "p_for_a_point": ["map_971p137MHz", "map_972p137MHz"],
    "underscore_for_a_point": ["map_900_11MHz", "map_901_12MHz"],
    "a_range": ["900-910MHz", "910-920MHz"],
    "a_range_of_units": ["900MHz-910MHz", "910MHz-920MHz"],
    "a_range_in_words": ["900to910MHz", "910to920MHz"],
    "two_frequencies": ["bw_20MHz_900MHz", "bw_20MHz_910MHz"],
    "a_bandwidth_alone": ["bw20MHz_a", "bw21MHz_b"],
    "an_exponent": ["1.4e3MHz", "1.5e3MHz"],
    "a_comma": ["900,5MHz", "901,5MHz"],
    "kilohertz": ["900000kHz", "901000kHz"],
    "a_longer_word": ["900MHzish", "901MHzish"],
    "a_point_before": ["map_.900MHz", "map_.901MHz"],
    "a_date_before": ["2020-01-01_900MHz", "2020-01-01_910MHz"],
}


@cases(**NAMES)
def file_names_with(names):
    write_folder("folder", names)
    return ["folder"], "does not tell its frequencies"


@cases(
    a_comma="1,20.5 MHz",
    a_range="900-910 MHz",
    no_number="MHz",
    two_numbers="900 MHz of 20 MHz",
    a_run_on="900_11MHz",
)
def column_names_with(name):
    write_fits("a.fits", good_maps()[:3], column_names=[name, "910 MHz", "920 MHz"])
    return ["a.fits"], "does not tell its frequencies"


@cases(words="900.0 MHz", truth=True, nothing="", not_a_number="nan")
def a_header_with_a_frequency_of(value):
    write_folder("folder", ["a", "b"], [[("FREQ", value)], [("FREQ", 910.0)]])
    return ["folder"], "FREQ in a header must be a number of MHz"


@cases(another=[900.0, 911.0], in_hertz=[9e8, 9.11e8], swapped=[910.0, 900.0])
def a_header_that_contradicts_the_name(values):
    write_folder("folder", ["900MHz", "910MHz"], [[("FREQ", value)] for value in values])
    return ["folder"], "names and headers"


@cases(without_names=["a", "b"], beside_half_of_the_names=["a_900MHz", "b"])
def frequencies_in_half_of_the_headers(names):
    write_folder("folder", names, [[("FREQ", 900.0)], []])
    return ["folder"], "does not tell its frequencies"


@cases(
    weights="freq_weights",
    index="freq_index",
    flag="nu_flag",
    temperature="tsys_mhz",
    noise="rms_mhz",
    width="bandwidth_mhz",
    offset="freqoffset",
    mask="freq_mask",
    numbers="nu_id",
)
def a_dataset_that_is_no_frequency(name):
    write_hdf5("a.h5", freqs_name=name)
    return ["a.h5"], "does not tell its frequencies"


@case
def a_dataset_whose_unit_is_that_of_a_frequency():
    write_hdf5("a.h5", freqs_name=None, more={"bandwidth": np.linspace(950, 960, 24)})
    with h5py.File("a.h5", "a") as file:
        file["bandwidth"].attrs["unit"] = "MHz"
    return ["a.h5"], "does not tell its frequencies"


@cases(
    units={"unit": "mK", "units": "K", "order": "RING"},
    orders={"unit": "mK", "order": "RING", "ordering": "NESTED"},
)
def two_attributes_that_contradict_each_other_as(said):
    write_hdf5("a.h5", said=said)
    return ["a.h5"], "say different things"


@case
def two_datasets_of_frequencies():
    write_hdf5("a.h5", more={"nu": FREQS + 1})
    return ["a.h5"], "--freqs-name"


@case
def a_name_and_a_unit_that_contradict_each_other():
    write_hdf5("a.h5", freqs_name="freq_ghz")
    with h5py.File("a.h5", "a") as file:
        file["freq_ghz"].attrs["unit"] = "MHz"
    return ["a.h5"], "freq_ghz"


@cases(of_the_sky=N_PIX, of_voxels=(24, N_PIX), of_pixels_first=(N_PIX, 24))
def a_mask_beside_the_maps(shape):
    write_hdf5("a.h5", more={"mask": np.zeros(shape, dtype=bool)})
    return ["a.h5"], "mask"


@cases(words="none", two=[1.0, 2.0])
def a_fill_value_of(value):
    write_hdf5("a.h5", _FillValue=value)
    return ["a.h5"], "_FillValue"


@cases(words="none", two=[1.0, 2.0], infinite=np.inf, nothing=0.0)
def a_scale_factor_of(value):
    write_hdf5("a.h5", scale_factor=value)
    return ["a.h5"], "scale_factor"


@case
def an_offset_of_words():
    write_hdf5("a.h5", add_offset="none")
    return ["a.h5"], "add_offset"


@case
def channels_in_two_tables():
    columns = [
        fits.Column(f"{freq:g} MHz", "E", "mK", array=m) for freq, m in zip(FREQS, good_maps(), strict=True)
    ]
    tables = [fits.BinTableHDU.from_columns(part) for part in (columns[:12], columns[12:])]
    for table in tables:
        table.header.update(PIXTYPE="HEALPIX", ORDERING="RING", NSIDE=NSIDE, INDXSCHM="IMPLICIT")
    fits.HDUList([fits.PrimaryHDU(), *tables]).writeto("a.fits")
    return ["a.fits"], "tables"


def _part(pixels):
    columns = [fits.Column("PIXEL", "J", array=np.asarray(pixels, dtype=np.int32))]
    columns += [
        fits.Column(f"{freq:g} MHz", "E", "mK", array=np.arange(1.0, 1 + len(pixels))) for freq in FREQS
    ]
    table = fits.BinTableHDU.from_columns(columns)
    table.header.update(
        PIXTYPE="HEALPIX", ORDERING="RING", NSIDE=NSIDE, INDXSCHM="EXPLICIT", OBJECT="PARTIAL"
    )
    table.writeto("a.fits", overwrite=True)


@cases(negative=[-1, 2, 3], beyond=[1, 2, N_PIX], twice=[1, 2, 2])
def pixel_numbers_that_are(pixels):
    _part(pixels)
    return ["a.fits"], "pixel"


@case
def pixel_numbers_alone():
    table = fits.BinTableHDU.from_columns([fits.Column("PIXEL", "J", array=np.arange(5))])
    table.header.update(PIXTYPE="HEALPIX", ORDERING="RING", NSIDE=NSIDE, INDXSCHM="EXPLICIT")
    table.writeto("a.fits")
    return ["a.fits"], "a.fits"


@case
def a_truth_that_is_the_cube_itself():
    return ["good.h5", "--truth", "good.h5"], "the truth is the cube"


@case
def a_truth_that_is_the_cube_in_another_file():
    np.save("t.npy", good_maps())
    return ["good.h5", "--truth", "t.npy", *READING], "the truth is the cube"


@cases(clean="clean", suggest="suggest", sensitivity="sensitivity", transfer="transfer")
def over_its_frequencies_by(command):
    os.rename("nu.txt", "nu.html")
    os.remove("nu.npy")
    method = ["--method", "beam_subspace", "--beam", "evolving", "-p", "n_sources=2"]
    more = method[:4] if command == "suggest" else method
    output = "nu.h5" if command == "clean" else "nu.html"
    words = [command, "good.npy", "--freqs", "nu.html", "--unit", "mK", *more, "-o", output, "--overwrite"]
    return words, "made from"


@case
def over_its_mask():
    os.rename("mask.fits", "m.fits")
    return ["good.h5", "--mask", "m.fits", "-o", "m.fits", "--overwrite"], "made from"


@case
def over_its_prior():
    words = ["good.h5", "--method", "gnilc", "-p", "prior=good.npy", "-o", "good.npy", "--overwrite"]
    return words, "made from"


@case
def over_its_cube_by_another_name():
    os.symlink("good.npy", "link.npy")
    return ["link.npy", *READING, "-o", "good.npy", "--overwrite"], "made from"


@case
def another_file_in_storage_elsewhere():
    with open("secret.txt", "wb") as file:
        file.write(good_maps().tobytes())
    write_hdf5("a.h5")
    with h5py.File("a.h5", "a") as file:
        del file["maps"]
        file.create_dataset("maps", (24, N_PIX), "f4", external=[("secret.txt", 0, h5py.h5f.UNLIMITED)])
    return ["a.h5"], "another file"


@case
def another_file_in_storage_elsewhere_for_frequencies():
    with open("secret.txt", "wb") as file:
        file.write(FREQS.tobytes())
    write_hdf5("a.h5", freqs_name=None)
    with h5py.File("a.h5", "a") as file:
        file.create_dataset("freqs", (24,), "f8", external=[("secret.txt", 0, h5py.h5f.UNLIMITED)])
    return ["a.h5"], "another file"


@case
def another_file_behind_a_link():
    write_hdf5("a.h5")
    with h5py.File("a.h5", "a") as file:
        del file["maps"]
        file["maps"] = h5py.ExternalLink("good.h5", "maps")
    return ["a.h5", "--maps", "maps"], "another file"


@case
def another_file_behind_a_virtual_dataset():
    write_hdf5("a.h5")
    layout = h5py.VirtualLayout((24, N_PIX), "f4")
    layout[...] = h5py.VirtualSource("good.h5", "maps", (24, N_PIX))
    with h5py.File("a.h5", "a") as file:
        del file["maps"]
        file.create_virtual_dataset("maps", layout)
    return ["a.h5"], "another file"


@case
def escape_codes_in_names():
    write_hdf5("a.h5", more={"\x1b[2J\x1b]0;owned\x07": good_maps()})
    return ["a.h5"], "\\x1b[2J"


@case
def names_that_are_long():
    write_hdf5("a.h5", more={f"{n}{'x' * 1000}": good_maps()[:2] for n in range(100)})
    return ["a.h5"], "Name it with --maps"


@cases(
    path="good.h5",
    beam="--beam",
    freqs="--freqs",
    mask="--mask",
    truth="--truth",
    mocks="--mocks",
    output="-o",
)
def a_name_of_300_bytes_as(option):
    name = "x" * 300 + ".h5"
    if option == "good.h5":
        return [name], "xxx"
    return ["good.h5", option, name], "xxx"


@cases(path="good.h5", beam="--beam", freqs="--freqs", mask="--mask", truth="--truth", mocks="--mocks")
def a_loop_of_links_as(option):
    os.symlink("loop.h5", "loop.h5")
    return (["loop.h5"] if option == "good.h5" else ["good.h5", option, "loop.h5"]), "loop.h5"


@cases(
    h5=["pipe.h5"],
    fits=["pipe.fits"],
    npy=["pipe.npy", *READING],
    beam=["good.h5", "--beam", "pipe.txt"],
    freqs=["good.npy", "--freqs", "pipe.txt", "--unit", "mK"],
    mask=["good.h5", "--mask", "pipe.fits"],
    truth=["good.h5", "--truth", "pipe.h5"],
    mocks=["good.h5", "--mocks", "pipe.h5"],
    prior=["good.h5", "--method", "gnilc", "-p", "prior=pipe.npy"],
)
def a_pipe_as(words):
    (name,) = (word.removeprefix("prior=") for word in words if "pipe" in word)
    os.mkfifo(name)
    return words, name


@case
def a_pipe_in_a_folder():
    write_folder("folder", ["900MHz", "910MHz"])
    os.mkfifo("folder/920MHz.fits")
    return ["folder"], "920MHz.fits"


@case
def a_folder_among_files():
    write_folder("folder", ["900MHz", "910MHz"])
    os.mkdir("folder/920MHz.fits")
    return ["folder"], "920MHz.fits"


@cases(beam="--beam", freqs="--freqs", mask="--mask")
def a_folder_as(option):
    os.mkdir("folder")
    return ["good.npy", "--freqs", "nu.txt", "--unit", "mK", option, "folder"], "folder"


@case
def three_thousand_nested_groups():
    with h5py.File("a.h5", "w") as file:
        group = file
        for _ in range(3000):
            group = group.create_group("g")
        group["maps"] = good_maps()
    return ["a.h5"], "groups"


@case
def groups_in_a_circle():
    write_hdf5("a.h5", freqs_name=None)
    with h5py.File("a.h5", "a") as file:
        file.create_group("one")["two"] = file["/"]
    return ["a.h5"], "does not tell its frequencies"


@case
def many_datasets():
    with h5py.File("a.h5", "w") as file:
        for n in range(10_001):
            file.create_group(f"{n}")
    return ["a.h5"], "groups"


@cases(chunks=True, no_chunks=None)
def petabytes_in_hdf5(chunks):
    write_hdf5("a.h5")
    with h5py.File("a.h5", "a") as file:
        del file["maps"]
        if chunks:
            file.create_dataset("maps", (24, 12 * 2**46), "f8", chunks=(1, 1024))
        else:
            plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            plist.set_alloc_time(h5py.h5d.ALLOC_TIME_LATE)
            space = h5py.h5s.create_simple((24, 12 * 2**46))
            h5py.h5d.create(file.id, b"maps", h5py.h5t.IEEE_F64LE, space, plist)
    return ["a.h5"], "GB"


@cases(
    array="(24, 12884901888)", flat="(10**17,)".replace("10**17", str(10**17)), channels=f"({10**15}, 192)"
)
def petabytes_in_npy(shape):
    npy_with_header("a.npy", f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}")
    return ["a.npy", *READING], "a.npy"


@cases(rows={"NAXIS2": 10**12}, width={"NAXIS1": 10**15}, nside={"NSIDE": 2**26}, negative={"NAXIS2": -5})
def petabytes_in_fits(cards):
    source = "part.fits" if "NSIDE" in cards else "good.fits"
    change_cards(source, "a.fits", **cards)
    return ["a.fits"], "a.fits"


@case
def petabytes_in_beams():
    npy_with_header("b.npy", f"{{'descr': '<f8', 'fortran_order': False, 'shape': (24, {10**13}), }}")
    return ["good.h5", "--beam", "b.npy"], "b.npy"


@cases(
    bad_shape="(-24, 192)",
    words="'words'",
    nested="((24, 192),)",
    floats="(24.0, 192)",
    huge_number=f"({'9' * 300}, 2)",
)
def shapes_in_npy_of(shape):
    npy_with_header("a.npy", f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}")
    return ["a.npy", *READING], "a.npy"


@cases(
    nothing="",
    a_list="[1, 2]",
    no_dictionary="{'descr'",
    no_shape="{'descr': '<f4', 'fortran_order': False}",
    a_type_of_words="{'descr': 'nothing', 'fortran_order': False, 'shape': (24, 192)}",
    a_type_of_numbers="{'descr': 7, 'fortran_order': False, 'shape': (24, 192)}",
    objects="{'descr': '|O', 'fortran_order': False, 'shape': (24, 192)}",
    brackets="(" * 2000,
    code="__import__('os').mkdir('owned')",
    nulls="\0\0\0",
)
def headers_of_npy_that_are(header):
    npy_with_header("a.npy", header)
    return ["a.npy", *READING], "a.npy"


@cases(
    dates=np.zeros((24, N_PIX), "M8[s]"),
    spans=np.zeros((24, N_PIX), "m8[s]"),
    words=np.full((24, N_PIX), "a"),
    bytes=np.full((24, N_PIX), b"a"),
    truth=np.ones((24, N_PIX), bool),
    complex=np.ones((24, N_PIX), complex),
    structures=np.zeros((24, N_PIX), [("a", "f4")]),
    voids=np.zeros((24, N_PIX), "V4"),
    three_axes=np.ones((24, 2, N_PIX)),
    no_axis=np.float64(3),
    no_pixels=np.ones((24, 0)),
    one_channel=np.ones((1, N_PIX)),
)
def arrays_of(array):
    np.save("a.npy", array)
    return ["a.npy", *READING], "a.npy" if array.shape != (1, N_PIX) else "channel"


@cases(
    words=np.full(24, "a"),
    structures=np.zeros(24, [("a", "f4"), ("b", "f4")]),
    complex=np.ones(24, complex),
    dates=np.zeros(24, "M8[s]"),
    truth=np.ones(24, bool),
    objects=np.array([None] * 24),
    nothing=np.zeros(0),
    a_number=np.float64(1.5),
    three_axes=np.ones((24, 3, 3)),
    not_a_number=np.full(24, np.nan),
    infinity=np.full(24, np.inf),
    negative=np.full(24, -1.0),
    b_l_with_nan=np.full((24, 12), np.nan),
    no_b_l=np.ones((24, 0)),
)
def beams_of(numbers):
    np.save("b.npy", numbers, allow_pickle=True)
    return ["good.h5", "--beam", "b.npy"], "b.npy"


@cases(
    words=np.full(24, "a"),
    structures=np.zeros(24, [("a", "f4")]),
    complex=np.ones(24, complex),
    dates=np.zeros(24, "M8[s]"),
    truth=np.ones(24, bool),
    not_a_number=np.full(24, np.nan),
    negative=-FREQS,
    two_columns=np.stack([FREQS, FREQS]),
    nothing=np.zeros(0, int),
)
def frequencies_of(numbers):
    np.save("f.npy", numbers)
    return [
        "good.npy",
        "--unit",
        "mK",
        "--freqs",
        "f.npy",
    ], "f.npy" if numbers.dtype.kind not in "f" else "freq"


@cases(
    latin=b"9\xe9\n",
    nulls=bytes(100),
    nothing=b"",
    ragged=b"1 2\n3\n",
    words=b"a\n",
    binary=bytes(range(256)),
)
def a_file_of_frequencies_with(content):
    with open("f.txt", "wb") as file:
        file.write(content)
    return ["good.npy", "--unit", "mK", "--freqs", "f.txt"], "f"


@cases(latin=b"1.5\xb0\n" * 24, words=b"wide\n" * 24, nulls=bytes(100), nothing=b"", ragged=b"1 2\n3\n")
def a_file_of_beams_with(content):
    with open("b.txt", "wb") as file:
        file.write(content)
    return ["good.h5", "--beam", "b.txt"], "b.txt"


@cases(
    undecodable=np.bytes_(b"\xff\xfe"),
    a_number=7,
    a_list=["mK", "K"],
    nothing=h5py.Empty("S1"),
    flux="Jy/beam",
    long="K" * 20_000,
)
def a_unit_of(value):
    write_hdf5("a.h5", said={"order": "RING"}, unit=value)
    return ["a.h5"], "unit"


@cases(latin=np.bytes_(b"R\xcfNG"), spiral="SPIRAL", a_number=1, long="RING" * 5000, escape="\x1b[31mRING")
def an_order_of(value):
    write_hdf5("a.h5", said={"unit": "mK"}, order=value)
    return ["a.h5"], "RING or NESTED"


@cases(words="parsec", latin=np.bytes_(b"\xb5Hz"), a_number=7, long="Hz" * 5000, brackets="(" * 5000)
def a_unit_of_frequencies_of(value):
    write_hdf5("a.h5")
    with h5py.File("a.h5", "a") as file:
        file["freqs"].attrs["unit"] = value
    return ["a.h5"], "Hz"


@cases(words=["a"] * 24, dates=np.arange(24), truth=np.ones(24, bool), complex=FREQS.astype(complex))
def frequencies_in_hdf5_of(values):
    values = np.asarray(values, dtype="S1") if isinstance(values, list) else values
    write_hdf5("a.h5", freqs=values)
    return ["a.h5"], "freq"


@case
def a_dataset_named_in_bytes_that_are_no_text():
    write_hdf5("a.h5")
    with h5py.File("a.h5", "a") as file:
        file.id.links.create_soft(b"\xff\xfe", b"maps")
        file.move("maps", b"\xe9\xff")
    return ["a.h5"], "cannot be read as HDF5"


@cases(maps="--maps", freqs="--freqs-name")
def names_of_datasets_for_a_folder(option):
    write_folder("folder", ["900MHz", "910MHz"])
    return ["folder", option, "x"], "HDF5"


@cases(fits=["good.fits"], npy=["good.npy", *READING])
def names_of_datasets_for(words):
    return [*words, "--maps", "x"], "HDF5"


@cases(
    to_a_billion=["--to", 10**9],
    to_ten_to_thirty=["--to", 10**30],
    from_nothing=["--from", 0],
    from_less=["--from", -5],
    to_less=["--to", 1],
    from_more=["--from", 24, "--to", 25],
)
def suggest_numbers(options):
    return ["suggest", "good.h5", "--keep-peaks", *options], "sources"


@cases(
    sources="n_sources=1000000000000",
    none="n_sources=0",
    words="n_sources=many",
    fraction="n_sources=2.5",
    infinite="n_sources=1e999",
)
def a_parameter_of(pair):
    return ["good.h5", "-p", pair], "n_sources"


@cases(claims="claims", readings="readings")
def numbers_of_sources_without_end_in(command):
    return [command, "-p", "n_sources_max=1000000000000"], "n_sources_max must be a whole number"


@cases(dish_of_nothing=["--beam", "evolving", "--dish", "nan"], dish_alone=["--dish", "3"])
def telescopes(options):
    return ["good.h5", *options], "dish"


@cases(many="1000000000000", none="0", negative="-3")
def mocks_in_number(word):
    return ["good.h5", "--beam", "evolving", "--mocks", word], "the number of mocks"


@cases(text=b"no mask", nothing=b"")
def masks_with(content):
    with open("m.fits", "wb") as file:
        file.write(content)
    return ["good.h5", "--mask", "m.fits"], "m.fits"


@case
def a_mask_without_an_order():
    with fits.open("mask.fits", mode="update") as file:
        del file[1].header["ORDERING"]
    return ["good.h5", "--mask", "mask.fits"], "ORDERING"


@case
def a_mask_in_hdf5():
    return ["good.h5", "--mask", "good.h5"], "good.h5"


@cases(complex="M", words="4A", bits="8X", lists="PE()")
def columns_of(form):
    values = {"M": np.ones(N_PIX, complex), "4A": np.full(N_PIX, "word"), "8X": np.ones((N_PIX, 8), bool)}
    lists = np.array([np.ones(2, np.float32)] * N_PIX + [None], dtype=object)[:-1]
    columns = [fits.Column(f"{freq:g} MHz", form, "mK", array=values.get(form, lists)) for freq in FREQS[:3]]
    table = fits.BinTableHDU.from_columns(columns)
    table.header.update(PIXTYPE="HEALPIX", ORDERING="RING", NSIDE=NSIDE)
    table.writeto("a.fits")
    return ["a.fits"], "a.fits"


@case
def an_image():
    fits.PrimaryHDU(np.ones((24, 10, 10))).writeto("a.fits")
    return ["a.fits"], "a.fits"


@case
def columns_of_two_lengths():
    one, two = np.ones((3, 64), np.float32), np.ones((3, 128), np.float32)
    table = fits.BinTableHDU.from_columns(
        [fits.Column("900 MHz", "64E", "mK", array=one), fits.Column("910 MHz", "128E", "mK", array=two)]
    )
    table.header.update(PIXTYPE="HEALPIX", ORDERING="RING", NSIDE=NSIDE)
    table.writeto("a.fits")
    return ["a.fits"], "a.fits"


@case
def an_nside_that_contradicts_the_table():
    change_cards("good.fits", "a.fits", NSIDE=8)
    return ["a.fits"], "a.fits"


@cases(cube="a.h5", fits="a.fits", npy="a.npy", text="a.txt", nothing="")
def an_empty_file_as_cube(name):
    if name:
        open(name, "w").close()
    return [name, *(READING if name.endswith("npy") else [])], name


@cases(folder="nowhere/c.h5", name="c.hdf5", nothing="", dots="..", null="c\0.h5")
def an_output_of(name):
    return ["good.h5", "-o", name], ""
