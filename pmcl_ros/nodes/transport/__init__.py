"""Transport of values between nodes, and loss accounting."""
