"""Commands that simulate pictures, and what robots do with them."""
