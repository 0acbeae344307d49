"""Commands that learn from generated scenes."""
