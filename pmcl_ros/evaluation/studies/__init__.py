"""Questions about the method, answered by many trials."""
