"""A first-generation Lytro down to its raw Bayer bytes: lenslets, main lens, sensor."""
