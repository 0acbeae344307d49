"""Scenes and sequences with exact truth, made by this package."""
