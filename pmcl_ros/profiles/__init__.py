"""Measures surfaces of revolution in posed views: an object model where there is no CAD."""
