"""How values travel between nodes, and how losses are counted."""
