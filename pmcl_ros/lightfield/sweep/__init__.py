"""Light fields from an ordinary camera that an arm moves from view to view."""
