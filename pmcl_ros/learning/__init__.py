"""The numbers that the package learns from simulated scenes, and how."""
