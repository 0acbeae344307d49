"""Robots that take objects from water, in simulation: the physics and what their cameras see."""
