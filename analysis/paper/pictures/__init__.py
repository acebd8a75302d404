"""The figures of the page: each finding names the one that shows it."""
