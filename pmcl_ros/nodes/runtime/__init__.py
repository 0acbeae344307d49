"""What every node is made of: lifecycle, parameters, health, threads, pose sources."""
