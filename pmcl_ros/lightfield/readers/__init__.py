"""Readers of light fields of known geometry, one file for each format."""
