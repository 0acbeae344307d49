"""Results as pictures, drawn without a screen."""
