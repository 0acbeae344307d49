"""A camera by way of another machine: for robots whose own Wi-Fi is taken."""
