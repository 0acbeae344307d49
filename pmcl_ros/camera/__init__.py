"""What can yield a RawFrame."""
