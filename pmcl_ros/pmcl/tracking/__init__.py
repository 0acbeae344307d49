"""An object followed from capture to capture."""
