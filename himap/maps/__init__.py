"""Maps on the sphere: transforms, masks, wavelets, and products with cubes."""
