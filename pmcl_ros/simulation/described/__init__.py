"""From what users say about their object and its surroundings to scenes."""
