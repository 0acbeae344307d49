"""The parts of every node: lifecycle, parameters, health, threads, pose sources."""
