"""A camera made of software that clients take for a first-generation Lytro."""
