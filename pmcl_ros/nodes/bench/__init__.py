"""A graph that a bench starts and listens to, and volumes sent between two processes."""
