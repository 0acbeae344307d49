"""Several objects in one capture: poses that explain it jointly."""
