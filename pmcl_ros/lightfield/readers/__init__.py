"""What a light field can be read from beside a camera's raw picture: a file for each format."""
