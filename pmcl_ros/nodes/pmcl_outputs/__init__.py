"""What pmcl_node publishes, by what it is of."""
