"""Maps of the sphere: transforms, masks, wavelets, products with cubes of them."""
