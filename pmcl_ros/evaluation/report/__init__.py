"""One localisation as a page to read: what was found, how sure that is, and what it rests on."""
