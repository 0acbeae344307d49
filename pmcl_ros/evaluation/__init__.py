"""Captures with truth -> trials, errors, tables and pages; benches and studies."""
