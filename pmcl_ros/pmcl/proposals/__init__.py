"""Proposes poses to begin the search at: templates of the outline are matched everywhere."""
