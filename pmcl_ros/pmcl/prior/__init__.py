"""Which poses are possible before anything is seen: where the object is, how it is turned."""
