"""Light fields of made-up table-top scenes, with exact truth."""
