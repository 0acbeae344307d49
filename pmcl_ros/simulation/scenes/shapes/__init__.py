"""Shapes of things in generated scenes."""
