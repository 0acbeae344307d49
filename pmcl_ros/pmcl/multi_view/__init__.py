"""Finds one object in several posed views together."""
