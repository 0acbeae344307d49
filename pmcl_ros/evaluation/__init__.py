"""Errors against the truth, and pictures of results."""
