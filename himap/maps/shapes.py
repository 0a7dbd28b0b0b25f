"""Which axis of an array is that of the pixels of a sphere."""

from himap.maps import sphere


def sphere_sizes(shape):
    """The numbers among `shape` that are those of the pixels of a sphere."""
    return [n for n in shape if sphere.is_n_pix(n)]


def pixels_last(maps):
    """`maps` as (n_channels, n_pix): the larger of the two sizes that a sphere can have is the pixels."""
    sizes = sphere_sizes(maps.shape)
    return maps if sizes and maps.shape[1] == max(sizes) else maps.T
