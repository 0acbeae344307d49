"""Draws results as pictures, without a screen."""
